// Error around the optimum of each parameter: a small plot for each parameter of each method.
import { usePage } from "./context";
import { Section } from "./controls";
import { number } from "./format";
import type { Style } from "./palette";
import type { Sensitivity } from "./results";
import { measuredMethods, nearest } from "./state";

const WIDTH = 260;
const HEIGHT = 150;
const EDGE = { left: 44, right: 10, top: 10, bottom: 24 };
/** Between the axis and the first and last value. */
const MARGIN = 10;

export function SensitivityView({ styles }: { styles: Map<string, Style> }) {
  const { index, view, name } = usePage();
  const metric = index.metrics.get(view.metric);
  const all = index.results.sensitivity.filter(
    (s) => s.scene === view.scene && s.region === view.region && s.metrics[view.metric],
  );
  const methods = measuredMethods(index, view, all);
  const spp = nearest(
    all.map((s) => s.spp),
    view.spp,
  );
  const several = all.some((s) => s.spp !== spp);
  if (methods.length === 0)
    return (
      <p class="empty">
        No parameter was varied for {view.scene}: {metric?.name}, {view.region}.
      </p>
    );
  return (
    <div class="sensitivity">
      <p class="note">
        {metric?.name} of {view.scene}, {view.region === "medium" ? "pixels of the medium" : "whole frame"}, when one
        parameter moves and the others stay.{" "}
        {several ? `Strong: ${spp} spp; pale: the other sample counts; ring` : `${spp} spp; ring`}: the value that the
        table was made with. Flat curves forgive, steep ones do not.
      </p>
      {methods.map((id) => {
        const own = all.filter((s) => s.method === id);
        const chosen = new Map(index.parameters(view.scene, spp, id));
        return (
          <Section key={id} title={name(id)}>
            <div class="small-plots">
              {[...new Set(own.map((s) => s.parameter))].map((parameter) => (
                <Curve
                  key={parameter}
                  parameter={parameter}
                  points={own.filter((s) => s.parameter === parameter)}
                  metric={view.metric}
                  spp={spp}
                  colour={styles.get(id)?.colour ?? "currentColor"}
                  chosen={chosen.get(parameter)}
                />
              ))}
            </div>
          </Section>
        );
      })}
    </div>
  );
}

function Curve(props: {
  parameter: string;
  points: Sensitivity[];
  metric: string;
  spp: number;
  colour: string;
  chosen: string | undefined;
}) {
  const { parameter, points, metric } = props;
  const error = (s: Sensitivity) => s.metrics[metric]!.mean;
  const numeric = points.every(
    (s) => typeof s.value === "number" || (s.value !== "" && !Number.isNaN(Number(s.value))),
  );
  const values = [...new Set(points.map((s) => String(s.value)))];
  if (numeric) values.sort((x, y) => Number(x) - Number(y));
  const positions = numeric ? values.map(Number) : values.map((_, i) => i);
  const logarithmic = numeric && positions[0]! > 0 && positions.at(-1)! / positions[0]! > 8;
  const place = (v: number) => (logarithmic ? Math.log(v) : v);
  const [x0, x1] = [place(positions[0]!), place(positions.at(-1)!)];
  const errors = points.map(error);
  const [low, high] = [Math.min(...errors), Math.max(...errors)];
  const pad = 0.06 * (high - low) || Math.abs(high) * 0.05 || 1;
  const x = (value: string | number) => {
    const at = place(numeric ? Number(value) : values.indexOf(String(value)));
    return EDGE.left + MARGIN + (x1 > x0 ? (at - x0) / (x1 - x0) : 0.5) * (WIDTH - EDGE.left - EDGE.right - 2 * MARGIN);
  };
  const y = (e: number) =>
    HEIGHT - EDGE.bottom - ((e - low + pad) / (high - low + 2 * pad)) * (HEIGHT - EDGE.top - EDGE.bottom);
  const counts = [...new Set(points.map((s) => s.spp))].sort(
    (p, q) => Number(p === props.spp) - Number(q === props.spp),
  );
  const summary = values.map(
    (v) =>
      `${v}: ${number(points.find((s) => String(s.value) === v && s.spp === counts.at(-1)) ? error(points.find((s) => String(s.value) === v && s.spp === counts.at(-1))!) : undefined)}`,
  );
  const ticks = numeric
    ? [...new Set([values[0]!, values[Math.floor(values.length / 2)]!, values.at(-1)!])]
    : values.slice(0, 4);
  return (
    <figure>
      <figcaption>{parameter}</figcaption>
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label={`Error by ${parameter}: ${summary.join("; ")}`}>
        {[low, (low + high) / 2, high].map((e, i) => (
          <g key={i}>
            <line class="grid-line" x1={EDGE.left} x2={WIDTH - EDGE.right} y1={y(e)} y2={y(e)} />
            <text x={EDGE.left - 6} y={y(e) + 4} text-anchor="end">
              {number(e)}
            </text>
          </g>
        ))}
        {ticks.map((v, i) => (
          <text
            key={v}
            x={x(v)}
            y={HEIGHT - 7}
            text-anchor={ticks.length > 1 && i === 0 ? "start" : i === ticks.length - 1 && i > 0 ? "end" : "middle"}
          >
            {v}
          </text>
        ))}
        {counts.map((spp) => {
          const strong = spp === counts.at(-1);
          const own = points.filter((s) => s.spp === spp).sort((p, q) => x(p.value) - x(q.value));
          return (
            <g key={spp} opacity={strong ? 1 : 0.4}>
              {numeric && (
                <polyline
                  points={own.map((s) => `${x(s.value).toFixed(1)},${y(error(s)).toFixed(1)}`).join(" ")}
                  fill="none"
                  stroke={props.colour}
                  stroke-width={strong ? 2.2 : 1.4}
                />
              )}
              {own.map((s) => (
                <circle key={String(s.value)} cx={x(s.value)} cy={y(error(s))} r={strong ? 3 : 2} fill={props.colour}>
                  <title>{`${spp} spp, ${parameter} ${s.value}: ${number(error(s))}`}</title>
                </circle>
              ))}
              {strong &&
                own
                  .filter((s) => same(String(s.value), props.chosen))
                  .map((s) => (
                    <circle key="chosen" class="chosen" cx={x(s.value)} cy={y(error(s))} r={6.5} fill="none" />
                  ))}
            </g>
          );
        })}
      </svg>
    </figure>
  );
}

function same(value: string, chosen: string | undefined): boolean {
  return (
    chosen !== undefined &&
    (value === chosen || Math.abs(Number(value) - Number(chosen)) <= 1e-6 * Math.abs(Number(value)))
  );
}
