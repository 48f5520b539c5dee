// Error against seconds and against samples, both axes logarithmic.
import { useLayoutEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { usePage } from "./context";
import { Saves, Section } from "./controls";
import { number, seconds as secondsText } from "./format";
import { useSize } from "./pane";
import { palette, type Style } from "./palette";
import { PLOT, plotSvg, rasterized, saveCsv, savePng, saveSvg } from "./figure";
import { totalSeconds, type Index, type Region } from "./results";
import { logTicks, plainTick, spread, type Line, type Point } from "./scales";
import { shownMethods } from "./state";

export function lines(
  index: Index,
  name: (id: string) => string,
  ids: string[],
  scene: string,
  region: Region,
  metric: string,
  axis: "seconds" | "spp",
  setting = "",
): Line[] {
  const result: Line[] = [];
  const zero = index.metrics.get(metric)?.better === "zero";
  for (const id of ids) {
    const points: Point[] = [];
    for (const spp of index.spp(scene)) {
      const row = index.row(scene, spp, id, region);
      const estimate = row?.metrics[metric];
      const x = axis === "spp" ? spp : totalSeconds(row?.seconds);
      if (!estimate || x === undefined) continue;
      const y = zero ? Math.abs(estimate.mean) : estimate.mean;
      const half = estimate.half_width ?? 0;
      const front = axis === "seconds" && index.isOnFront(scene, region, metric, setting, id, spp);
      points.push({ x, y, low: y - half, high: y + half, spp, front });
    }
    if (points.length) result.push({ id, name: name(id), points: points.sort((p, q) => p.x - q.x) });
  }
  return result;
}

export function Plots({ styles }: { styles: Map<string, Style> }) {
  const { index, view, name } = usePage();
  const metric = index.metrics.get(view.metric);
  const ids = shownMethods(index, view);
  const error = `${metric?.name ?? "error"}${metric?.better === "zero" ? ", magnitude" : ""}${metric?.unit ? ` [${metric.unit}]` : ""}`;
  const over = view.region === "medium" ? "pixels of the medium" : "whole frame";
  const bySeconds = lines(index, name, ids, view.scene, view.region, view.metric, "seconds", view.setting);
  const bySpp = lines(index, name, ids, view.scene, view.region, view.metric, "spp");
  const hasFront = bySeconds.some((l) => l.points.some((p) => p.front));
  return (
    <div class="plots">
      {bySeconds.length > 0 && (
        <Section
          title={`${view.scene}: error against seconds`}
          note={
            <>
              {error}, {over}. Seconds of rendering, guides and filtering; the further to the lower left the better.
              {hasFront &&
                ` Rings: the Pareto front by this metric over these pixels; nothing else${view.setting ? ` with ${view.setting} parameters` : ""} is both faster and better${view.hidden.length ? ", methods that are left out among them" : ""}.`}
            </>
          }
        >
          <Plot
            lines={bySeconds}
            styles={styles}
            x="render + guides + filter [s]"
            y={error}
            label={`${view.scene}: ${error} against seconds`}
            over={over}
          />
        </Section>
      )}
      {bySpp.length > 0 && (
        <Section title={`${view.scene}: error against samples`} note={`${error}, ${over}, with 95 % intervals.`}>
          <Plot
            lines={bySpp}
            styles={styles}
            x="samples per pixel"
            y={error}
            label={`${view.scene}: ${error} against samples per pixel`}
            over={over}
          />
        </Section>
      )}
      {bySeconds.length + bySpp.length === 0 && <p class="empty">{metric?.name} was not measured here.</p>}
    </div>
  );
}

/** The sample counts, where these are the horizontal axis. */
function countsOf(props: { lines: Line[]; x: string }): number[] | undefined {
  if (props.x.includes("[s]")) return undefined;
  return [...new Set(props.lines.flatMap((l) => l.points.map((p) => p.x)))].sort((p, q) => p - q);
}

function Plot(props: {
  lines: Line[];
  styles: Map<string, Style>;
  x: string;
  y: string;
  label: string;
  /** Which pixels count, for the figure's title. */
  over: string;
}) {
  const { dark, index, view, set } = usePage();
  const host = useRef<HTMLDivElement>(null);
  const tip = useRef<HTMLDivElement>(null);
  const { width } = useSize(host);
  useLayoutEffect(() => {
    if (!host.current || !width) return;
    const plot = new uPlot(
      options(props, width, dark, tip.current!, (id) => set({ b: id })),
      table(props.lines),
      host.current,
    );
    return () => plot.destroy();
  }, [
    props.lines.map((l) => l.id + l.points.map((p) => `${p.x} ${p.y}`).join()).join(),
    props.lines.map((l) => l.points.map((p) => p.front)).join(),
    props.y,
    width,
    dark,
    view.scene,
  ]);
  const { brume, commit, command } = index.results;
  const figure = () =>
    plotSvg({
      title: `${props.label}${props.over ? `, ${props.over}` : ""}`,
      origin: `brume ${brume ?? ""} ${commit ?? ""}: ${command ?? ""}`,
      x: props.x,
      y: props.y,
      lines: props.lines,
      styles: palette(index.results, false),
      ticks: countsOf(props),
    });
  const file = `${view.scene}_${view.metric}_${view.region}_${countsOf(props) ? "spp" : "seconds"}`;
  return (
    <div class="plot">
      <Saves
        what={props.label}
        csv={() =>
          saveCsv(file, [
            ["scene", "region", "metric", "method", "spp", props.x, view.metric, "low", "high", "pareto front"],
            ...props.lines.flatMap((l) =>
              l.points.map((p) => [
                view.scene,
                view.region,
                view.metric,
                l.id,
                p.spp,
                p.x,
                p.y,
                p.low,
                p.high,
                p.front ? "yes" : "",
              ]),
            ),
          ])
        }
        svg={() => saveSvg(file, figure())}
        png={() => void rasterized(figure(), PLOT.width, PLOT.height).then((canvas) => savePng(file, canvas))}
      />
      <div ref={host} role="img" aria-label={`${props.label}; the numbers are under Numbers`} />
      <div ref={tip} class="tip" hidden />
      <ul class="key">
        {props.lines.map(({ id, name }) => {
          const style = props.styles.get(id)!;
          return (
            <li key={id}>
              <svg width="26" height="10" aria-hidden="true">
                <line
                  x1="1"
                  x2="25"
                  y1="5"
                  y2="5"
                  stroke={style.colour}
                  stroke-width="2.5"
                  stroke-dasharray={style.dash.join(" ")}
                />
                <circle cx="13" cy="5" r="3" fill={style.colour} />
              </svg>
              {name}
            </li>
          );
        })}
      </ul>
    </div>
  );
}

/** One column of x values for all lines, each line with gaps where it has no point. */
function table(series: Line[]): uPlot.AlignedData {
  const tables = series.map((line): uPlot.AlignedData => [
    line.points.map((p) => p.x),
    line.points.map((p) => (p.y > 0 ? p.y : null)),
  ]);
  return tables.length
    ? uPlot.join(
        tables,
        tables.map((t) => t.map(() => 2)),
      )
    : [[]];
}

function options(
  props: { lines: Line[]; styles: Map<string, Style>; x: string; y: string },
  width: number,
  dark: boolean,
  tip: HTMLElement,
  choose: (id: string) => void,
): uPlot.Options {
  const ink = dark ? "#aab4be" : "#4c5661";
  const grid = { stroke: dark ? "rgba(255,255,255,.08)" : "rgba(0,0,0,.08)", width: 1 };
  const font = "12px system-ui, sans-serif";
  const axis = { stroke: ink, grid, ticks: { ...grid, size: 5 }, font, labelFont: font, labelSize: 22 };
  const [x0, x1] = spread(props.lines.flatMap((l) => l.points.map((p) => p.x)));
  const [y0, y1] = spread(props.lines.flatMap((l) => l.points.flatMap((p) => [p.y, p.high, Math.max(p.low, p.y / 2)])));
  const counts = countsOf(props);
  const ticks = (_: uPlot, __: number, low: number, high: number) => logTicks(low, high);
  const text = (_: uPlot, values: (number | null)[]) => values.map((v) => (v === null ? "" : plainTick(v)));
  let near: { id: string } | undefined;
  return {
    width,
    height: Math.round(Math.min(460, Math.max(300, width * 0.5))),
    padding: [12, 12, 0, 0],
    legend: { show: false },
    cursor: { drag: { x: false, y: false }, points: { show: false } },
    scales: {
      x: { time: false, distr: 3, range: () => [x0, x1] },
      y: { distr: 3, range: () => [y0, y1] },
    },
    axes: [
      { ...axis, label: props.x, splits: counts ? () => counts : ticks, values: text, filter: (_, v) => v },
      { ...axis, label: props.y, size: 58, splits: ticks, values: text, filter: (_, v) => v },
    ],
    series: [
      {},
      ...props.lines.map((line): uPlot.Series => {
        const style = props.styles.get(line.id)!;
        return {
          label: line.name,
          stroke: style.colour,
          width: 2,
          dash: style.dash,
          spanGaps: true,
          points: { show: true, size: 7, fill: style.colour, stroke: style.colour },
        };
      }),
    ],
    hooks: {
      draw: [(plot) => drawSpreads(plot, props.lines, props.styles, dark)],
      ready: [(plot) => plot.over.addEventListener("click", () => near && choose(near.id))],
      setCursor: [
        (plot) => {
          const { left = -1, top = -1 } = plot.cursor;
          let closest = 24;
          let found: { line: Line; point: Point; x: number; y: number } | undefined;
          for (const line of props.lines)
            for (const point of line.points) {
              if (left < 0 || !(point.y > 0)) continue;
              const [x, y] = [plot.valToPos(point.x, "x"), plot.valToPos(point.y, "y")];
              const distance = Math.hypot(x - left, y - top);
              if (distance < closest) [closest, found] = [distance, { line, point, x, y }];
            }
          near = found?.line;
          tip.hidden = !found;
          if (!found) return;
          const { line, point } = found;
          const half = point.high - point.y;
          tip.textContent = `${line.name}, ${point.spp} spp: ${number(point.y)}${half > 0 ? ` ± ${number(half)}` : ""}${props.x.includes("[s]") ? `, ${secondsText(point.x)}` : ""}`;
          tip.style.left = `${Math.min(found.x + plot.over.offsetLeft + 12, width - tip.offsetWidth - 4)}px`;
          tip.style.top = `${Math.max(0, found.y + plot.over.offsetTop - 34)}px`;
        },
      ],
    },
  };
}

/** Intervals as bars, points of the Pareto front as rings. */
function drawSpreads(plot: uPlot, series: Line[], styles: Map<string, Style>, dark: boolean): void {
  const { ctx } = plot;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(plot.bbox.left, plot.bbox.top - 8 * ratio, plot.bbox.width + 8 * ratio, plot.bbox.height + 8 * ratio);
  ctx.clip();
  for (const line of series) {
    ctx.strokeStyle = styles.get(line.id)!.colour;
    for (const point of line.points) {
      if (!(point.y > 0)) continue;
      const x = plot.valToPos(point.x, "x", true);
      const y = plot.valToPos(point.y, "y", true);
      if (point.high > point.y) {
        const top = plot.valToPos(point.high, "y", true);
        const bottom = point.low > 0 ? plot.valToPos(point.low, "y", true) : plot.bbox.top + plot.bbox.height;
        ctx.lineWidth = 1.5 * ratio;
        ctx.beginPath();
        ctx.moveTo(x, top);
        ctx.lineTo(x, bottom);
        for (const end of [top, bottom]) {
          ctx.moveTo(x - 3 * ratio, end);
          ctx.lineTo(x + 3 * ratio, end);
        }
        ctx.stroke();
      }
      if (point.front) {
        ctx.save();
        ctx.strokeStyle = dark ? "#fff" : "#000";
        ctx.lineWidth = 1.5 * ratio;
        ctx.beginPath();
        ctx.arc(x, y, 7 * ratio, 0, 2 * Math.PI);
        ctx.stroke();
        ctx.restore();
      }
    }
  }
  ctx.restore();
}
