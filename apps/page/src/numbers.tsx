// Tables: every metric of every method, who beats whom, time to an error, what failed.
import { usePage } from "./context";
import { Saves, ScrollTable, Section } from "./controls";
import { saveCsv } from "./figure";
import { breakable, bytes, number, seconds, signed } from "./format";
import { isBetter, isUnfiltered, settingOf, totalSeconds, type Estimate, type Metric, type Row } from "./results";
import { listedMethods, shownMethods, type View } from "./state";

interface Column {
  id: string;
  name: string;
  title: string;
  /** What rows are sorted by; nothing sorts last. */
  value: (row: Row | undefined, id: string) => number | string | undefined;
  metric?: Metric;
}

export function Numbers() {
  const { index, view, set, name } = usePage();
  const { scene, spp, region } = view;
  const rows = shownMethods(index, view);
  const rowOf = (id: string) => index.row(scene, spp, id, region);
  const measured = index.results.metrics.filter((m) => rows.some((id) => rowOf(id)?.metrics[m.id]));
  const any = (what: (row: Row) => unknown) => rows.some((id) => rowOf(id) && what(rowOf(id)!));
  const metricColumn = (metric: Metric): Column => ({
    id: metric.id,
    name: metric.name,
    title: `${metric.definition ?? metric.name}${metric.unit ? ` [${metric.unit}]` : ""}; ${BETTER[metric.better]} is better`,
    metric,
    value: (row: Row | undefined) => {
      const mean = row?.metrics[metric.id]?.mean;
      return mean !== undefined && metric.better === "zero" ? Math.abs(mean) : mean;
    },
  });

  // What a method costs stands beside the metric that is looked at.
  const columns: Column[] = [
    { id: "method", name: "Method", title: "Name", value: (_, id) => name(id) },
    ...measured.filter((m) => m.id === view.metric).map(metricColumn),
    ...(any((r) => totalSeconds(r.seconds) !== undefined)
      ? [
          {
            id: "total",
            name: "In all",
            title: "Seconds to render, of guides and to filter",
            value: (r?: Row) => totalSeconds(r?.seconds),
          },
        ]
      : []),
    ...(any((r) => r.peak_memory_bytes)
      ? [
          {
            id: "memory",
            name: "Memory",
            title: "Most memory that the filter held at a time beside its input",
            value: (r?: Row) => r?.peak_memory_bytes ?? undefined,
          },
        ]
      : []),
    ...measured.filter((m) => m.id !== view.metric).map(metricColumn),
    ...(any((r) => r.seconds?.render !== undefined)
      ? [{ id: "render", name: "Render", title: "Seconds to render", value: (r?: Row) => r?.seconds?.render }]
      : []),
    ...(any((r) => r.seconds?.guides)
      ? [
          {
            id: "guides",
            name: "Guides",
            title: "Seconds for guides and the layers that the filter needs",
            value: (r?: Row) => r?.seconds?.guides,
          },
        ]
      : []),
    ...(any((r) => r.seconds?.filter !== undefined)
      ? [{ id: "filter", name: "Filter", title: "Seconds to filter", value: (r?: Row) => r?.seconds?.filter }]
      : []),
  ];
  const sortOf = (v: View) => columns.find((c) => c.id === v.sort) ?? columns[1] ?? columns[0]!;
  const sort = sortOf(view);
  const sign = (sort.metric?.better === "higher") !== view.descending ? -1 : 1;
  const sorted = [...rows].sort((x, y) => {
    const [u, v] = [sort.value(rowOf(x), x), sort.value(rowOf(y), y)];
    if (u === undefined || v === undefined) return Number(u === undefined) - Number(v === undefined);
    return sign * (typeof u === "string" ? u.localeCompare(String(v)) : u - Number(v));
  });
  const best = new Map(measured.map((m) => [m.id, bestOf(m, rows, (id) => rowOf(id)?.metrics[m.id]?.mean)]));
  const level = (metric: string, id: string) => {
    const first = best.get(metric);
    return !!first && first !== id && index.verdict(scene, spp, region, metric, first, id)?.better === null;
  };

  const saveTable = () =>
    saveCsv(`${scene}_${spp}spp_${region}`, [
      [
        ...["scene", "spp", "region", "method", "label", "setting"],
        ...measured.flatMap((m) => [m.id, `${m.id}_ci95`]),
        ...["render_seconds", "guide_seconds", "filter_seconds", "peak_memory_bytes", "failed"],
      ],
      ...sorted.map((id) => {
        const row = rowOf(id);
        const method = index.methods.get(id)!;
        return [
          ...[scene, spp, region, id, method.label, settingOf(method)],
          ...measured.flatMap((m) => [row?.metrics[m.id]?.mean, row?.metrics[m.id]?.half_width]),
          ...[row?.seconds?.render, row?.seconds?.guides, row?.seconds?.filter, row?.peak_memory_bytes, row?.failed],
        ];
      }),
    ]);

  return (
    <div class="numbers">
      <Section
        title={`${scene}, ${spp} spp, ${region === "medium" ? "pixels of the medium" : "whole frame"}`}
        saves={<Saves what="every metric, seconds and memory of these methods" csv={saveTable} />}
        note={
          <>
            Means over {index.results.seeds?.length ?? "the"} seeds with the half width of their 95 % interval.{" "}
            <span class="mark best">●</span> best of a column
            {(index.results.seeds?.length ?? 0) > 1 && (
              <>
                , <span class="mark level">○</span> not told apart from it by the paired difference
              </>
            )}
            .
          </>
        }
      >
        <div class="scroll" tabIndex={0} role="region" aria-label="Table of metrics">
          <table class="metrics main">
            <thead>
              <tr>
                {columns.map((c) => (
                  <th
                    key={c.id}
                    scope="col"
                    aria-sort={c.id === sort.id ? (sign > 0 ? "ascending" : "descending") : "none"}
                  >
                    <button
                      type="button"
                      title={c.title}
                      onClick={() =>
                        set((now) => ({ sort: c.id, descending: c.id === sortOf(now).id ? !now.descending : false }))
                      }
                    >
                      {c.name}
                      <span class="arrow" aria-hidden="true">
                        {c.id === sort.id ? (sign > 0 ? "▲" : "▼") : ""}
                      </span>
                    </button>
                  </th>
                ))}
              </tr>
            </thead>
            <tbody>
              {sorted.map((id) => {
                const row = rowOf(id);
                const method = index.methods.get(id)!;
                return (
                  <tr key={id} data-method={id} class={id === view.a ? "is-a" : id === view.b ? "is-b" : ""}>
                    <th scope="row">
                      {breakable(method.label)}
                      {view.setting === "" && settingOf(method) && <small> {settingOf(method)}</small>}
                      {row?.failed && <span class="failed"> failed</span>}
                    </th>
                    {columns.slice(1).map((c) => {
                      if (c.metric) {
                        const e = row?.metrics[c.metric.id];
                        const mark = best.get(c.id) === id ? "best" : level(c.id, id) ? "level" : "";
                        return (
                          <td key={c.id} data-metric={c.id} data-value={e?.mean} class={mark}>
                            {mark && <span class={`mark ${mark}`}>{mark === "best" ? "●" : "○"}</span>}
                            {e ? (c.metric.better === "zero" ? signed(e.mean) : number(e.mean)) : "–"}
                            {e?.half_width ? <small> ± {number(e.half_width)}</small> : ""}
                          </td>
                        );
                      }
                      const v = c.value(row, id) as number | undefined;
                      return <td key={c.id}>{c.id === "memory" ? bytes(v) : seconds(v)}</td>;
                    })}
                  </tr>
                );
              })}
            </tbody>
          </table>
        </div>
      </Section>
      <Matrix methods={sorted} />
      <Lights methods={sorted} />
      <TimeToError />
      <Sequences />
      <Failures />
    </div>
  );
}

const BETTER = { lower: "lower", higher: "higher", zero: "closer to 0" };

function bestOf(metric: Metric, ids: string[], value: (id: string) => number | undefined): string | undefined {
  let best: string | undefined;
  for (const id of ids) {
    const v = value(id);
    if (v === undefined || v === null) continue;
    if (best === undefined || isBetter(metric, v, value(best)!)) best = id;
  }
  return best;
}

/** Each method against each other, by the paired differences over the seeds. */
function Matrix({ methods }: { methods: string[] }) {
  const { index, view, name } = usePage();
  const { scene, spp, region } = view;
  const metric = index.isPaired(view.metric)
    ? view.metric
    : (index.results.metrics.find((m) => index.isPaired(m.id))?.id ?? "");
  const verdict = (row: string, column: string) => index.verdict(scene, spp, region, metric, row, column);
  const there = methods.filter((id) => methods.some((other) => verdict(id, other)));
  if (there.length < 2) return null;
  const wins = (id: string) => there.filter((other) => verdict(id, other)?.better === "row").length;
  const ordered = [...there].sort((x, y) => wins(y) - wins(x));
  return (
    <Section
      title={`Who beats whom: ${index.metrics.get(metric)?.name ?? metric}`}
      note="Row against column, paired over seeds: a filled square where the row is better, an empty one where it is worse, a dot where the seeds cannot tell (5 % level over all pairs). Point at a cell for the difference."
    >
      <div class="scroll" tabIndex={0} role="region" aria-label="Matrix of methods">
        <table class="matrix">
          <thead>
            <tr>
              <th scope="col">better than</th>
              {ordered.map((id) => (
                <th key={id} scope="col">
                  <span>{name(id)}</span>
                </th>
              ))}
              <th scope="col">
                <span>beats</span>
              </th>
            </tr>
          </thead>
          <tbody>
            {ordered.map((row) => (
              <tr key={row}>
                <th scope="row">{name(row)}</th>
                {ordered.map((column) => {
                  const v = row === column ? undefined : verdict(row, column);
                  if (!v) return <td key={column} class="none" />;
                  const kind = v.better === "row" ? "win" : v.better === "column" ? "loss" : "even";
                  const text = `${name(row)} − ${name(column)}: ${signed(v.difference)} ± ${number(v.half_width)}`;
                  return (
                    <td key={column} class={kind} title={text}>
                      <span class="hidden-text">{kind === "win" ? "better" : kind === "loss" ? "worse" : "level"}</span>
                      <span aria-hidden="true">{kind === "win" ? "■" : kind === "loss" ? "□" : "·"}</span>
                    </td>
                  );
                })}
                <td class="count">{wins(row)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </Section>
  );
}

/** Direct and indirect light and light groups by themselves, in the metric that is looked at, or the first where that needs the picture. */
function Lights({ methods }: { methods: string[] }) {
  const { index, view, name } = usePage();
  const { scene, spp, region } = view;
  const rows = methods
    .map((id) => index.row(scene, spp, id, region))
    .filter((row): row is Row & Required<Pick<Row, "lights">> => !!row?.lights);
  const known = [...new Set(rows.flatMap((row) => Object.keys(row.lights)))];
  if (!rows.some((row) => !isUnfiltered(index.methods.get(row.method)!))) return null;
  const there = (id: string) => rows.some((row) => known.some((light) => row.lights[light]?.[id]));
  const metric = index.results.metrics.find((m) => m.id === view.metric && there(m.id)) ?? index.results.metrics[0]!;
  const cell = (e: Estimate | undefined) => <td>{e ? `${number(e.mean)} ± ${number(e.half_width ?? 0)}` : "–"}</td>;
  return (
    <Section
      title={`Lights by themselves: ${metric.name}`}
      note="Of the light scattered once and of the rest, and of each light group, against the reference's own, where a method cleans them apart."
    >
      <ScrollTable label="Lights by themselves" class="metrics lights" columns={["Method", "Picture", ...known]}>
        {rows.map((row) => (
          <tr key={row.method}>
            <th scope="row">{name(row.method)}</th>
            {cell(row.metrics[metric.id])}
            {known.map((light) => cell(row.lights[light]?.[metric.id]))}
          </tr>
        ))}
      </ScrollTable>
    </Section>
  );
}

function TimeToError() {
  const { index, view, name } = usePage();
  const shown = shownMethods(index, view);
  const metric = index.metrics.get(view.metric);
  const entries = index
    .times(view.scene, view.region, view.metric)
    .filter((t) => shown.includes(t.method))
    .sort(
      (x, y) =>
        (metric?.better === "higher" ? y.error - x.error : x.error - y.error) ||
        (x.seconds ?? Infinity) - (y.seconds ?? Infinity),
    );
  if (entries.length === 0) return null;
  const factor = (v: number | null | undefined) => (v === null || v === undefined ? "–" : `${number(v)} ×`);
  return (
    <Section
      title={`${view.scene}: time to an error`}
      saves={
        <Saves
          what="time to an error"
          csv={() =>
            saveCsv(`${view.scene}_time_to_${view.metric}_${view.region}`, [
              ["scene", "region", "method", view.metric, "seconds", "over_path_tracing", "over_gradient_kernel"],
              ...entries.map((t) => [
                ...[view.scene, view.region, t.method, t.error, t.seconds],
                ...[t.factor_over_path_tracing, t.factor_over_gradient_kernel],
              ]),
            ])
          }
        />
      }
      note={`Seconds of rendering, guides and filtering until a method has come to the ${metric?.name ?? "error"} given, ${view.region === "medium" ? "over the pixels of the medium" : "over the whole frame"}, between the neighbouring sample counts, and how many times faster that is.`}
    >
      <ScrollTable
        label="Time to an error"
        class="metrics times"
        columns={["Method", metric?.name ?? "Error", "Time", "than path tracing", "than the gradient kernel"]}
      >
        {entries.map((t, i) => (
          <tr key={i} data-method={t.method}>
            <th scope="row">{name(t.method)}</th>
            <td>{number(t.error)}</td>
            <td>{t.seconds === null ? "not reached" : seconds(t.seconds)}</td>
            <td>{factor(t.factor_over_path_tracing)}</td>
            <td>{factor(t.factor_over_gradient_kernel)}</td>
          </tr>
        ))}
      </ScrollTable>
    </Section>
  );
}

/** Sequences at the sample count and over the pixels that are looked at. */
function Sequences() {
  const { index, view } = usePage();
  // Of a method that is left out in every listed setting nothing is told.
  const leftOut = new Set(listedMethods(index, view).map((id) => index.label(id)));
  for (const id of shownMethods(index, view)) leftOut.delete(index.label(id));
  const estimate = (e: Estimate | undefined, text: (value: number) => string = number) =>
    e ? `${text(e.mean)} ± ${number(e.half_width ?? 0)}` : "–";
  return (
    <>
      {index.results.sequences.map(({ name, frames, reference_change, rows }) => {
        const counts = [...new Set(rows.map((r) => r.spp))];
        const spp = counts.includes(view.spp) ? view.spp : counts[0];
        const regions = new Set(rows.map((r) => r.region));
        const region = regions.has(view.region) ? view.region : "frame";
        return (
          <Section
            key={name}
            title={`${name}: ${frames.length} frames through time, ${spp} spp, ${region}`}
            note={`Temporal error: how the picture changes from frame to frame less how the reference does (${number(reference_change[region])} by itself), RMS in CIE-Lab. Flicker: how much more than the reference it changes; below zero where a filter smears.`}
          >
            <ScrollTable
              label={`${name} through time`}
              class="metrics sequence"
              columns={["Method", "Frames beside", "Lab RMS", "Temporal error", "Flicker", "Filter"]}
            >
              {rows
                .filter((r) => r.spp === spp && r.region === region && !leftOut.has(r.label))
                .sort((x, y) => (x.temporal_error?.mean ?? Infinity) - (y.temporal_error?.mean ?? Infinity))
                .map((r, i) => (
                  <tr key={i}>
                    <th scope="row">{r.label}</th>
                    <td>{r.reach}</td>
                    {r.failed ? (
                      <td colSpan={3}>{r.failed}</td>
                    ) : (
                      <>
                        <td>{estimate(r.lab_rms)}</td>
                        <td>{estimate(r.temporal_error)}</td>
                        <td>{estimate(r.flicker, signed)}</td>
                      </>
                    )}
                    <td>{seconds(r.filter_seconds)}</td>
                  </tr>
                ))}
            </ScrollTable>
          </Section>
        );
      })}
    </>
  );
}

function Failures() {
  const { index, name, view } = usePage();
  const shown = shownMethods(index, view);
  const seen = new Set<string>();
  const all = index.results.rows.filter((r) => {
    const key = `${r.scene} ${r.spp} ${r.method} ${r.failed}`;
    return r.failed && !seen.has(key) && seen.add(key);
  });
  const once = all.filter((r) => shown.includes(r.method));
  const others = all.length - once.length;
  if (all.length === 0) return null;
  return (
    <Section
      title="What failed"
      note={
        others
          ? `${once.length ? "" : "Nothing here; "}${others} more among the methods that are not listed.`
          : undefined
      }
    >
      <ul class="failures">
        {once.map((r, i) => (
          <li key={i}>
            <b>{name(r.method)}</b>, {r.scene}, {r.spp} spp: {r.failed}
          </li>
        ))}
      </ul>
    </Section>
  );
}
