// What leaves the page as files: tables as CSV, plots as SVG and PNG, pictures as PNG.
import type { Style } from "./palette";
import { logTicks, plainTick, spread, type Line } from "./scales";

/** A file name that every system takes. */
export function fileName(words: string): string {
  return `brume_${words.replace(/[^A-Za-z0-9._-]+/g, "_")}`;
}

export type Cell = string | number | null | undefined;

/** RFC 4180: fields with commas, quotes or line ends are quoted; numbers with every digit, what is not there is empty. */
export function csv(rows: readonly (readonly Cell[])[]): string {
  const field = (cell: Cell) => {
    const text = cell === null || cell === undefined || Number.isNaN(cell) ? "" : String(cell);
    return /[",\r\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text;
  };
  return rows.map((row) => row.map(field).join(",") + "\r\n").join("");
}

/** Hands a file to the browser's downloads. */
export function save(name: string, content: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

export function saveCsv(name: string, rows: readonly (readonly Cell[])[]): void {
  save(`${fileName(name)}.csv`, new Blob([csv(rows)], { type: "text/csv" }));
}

export function saveSvg(name: string, svg: string): void {
  save(`${fileName(name)}.svg`, new Blob([svg], { type: "image/svg+xml" }));
}

export async function savePng(name: string, canvas: HTMLCanvasElement): Promise<void> {
  const blob = await new Promise<Blob | null>((done) => canvas.toBlob(done, "image/png"));
  if (blob) save(`${fileName(name)}.png`, blob);
}

/** An SVG as pixels, twice as many as it has units. */
export async function rasterized(svg: string, width: number, height: number): Promise<HTMLCanvasElement> {
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [2 * width, 2 * height];
  canvas.getContext("2d")!.drawImage(image, 0, 0, canvas.width, canvas.height);
  return canvas;
}

/** A picture of a figure, at its own size, and what stands under it. */
export interface Tile {
  canvas: HTMLCanvasElement;
  caption: string;
  value: string;
}

const GAP = 12;
const CAPTION = 40;

/** Pictures beside one another on white, in rows of a figure that is about as wide as high. */
export function drawTiles(tiles: readonly Tile[]): HTMLCanvasElement {
  const figure = document.createElement("canvas");
  const width = Math.max(1, ...tiles.map((t) => t.canvas.width));
  const height = Math.max(1, ...tiles.map((t) => t.canvas.height));
  // Small pictures grow by whole factors: each pixel stays a square.
  const factor = Math.max(1, Math.round(240 / width));
  const [w, h] = [factor * width, factor * height];
  const columns = tiles.length <= 3 ? Math.max(1, tiles.length) : Math.ceil(Math.sqrt(tiles.length));
  figure.width = columns * (w + GAP) + GAP;
  figure.height = Math.ceil(tiles.length / columns) * (h + CAPTION + GAP) + GAP;
  const context = figure.getContext("2d")!;
  context.fillStyle = "#fff";
  context.fillRect(0, 0, figure.width, figure.height);
  context.imageSmoothingEnabled = false;
  context.textBaseline = "top";
  tiles.forEach(({ canvas, caption, value }, i) => {
    const x = GAP + (i % columns) * (w + GAP);
    const y = GAP + Math.floor(i / columns) * (h + CAPTION + GAP);
    context.drawImage(canvas, x, y, w, h);
    context.fillStyle = "#000";
    context.font = "600 14px system-ui, sans-serif";
    context.fillText(caption, x, y + h + 4, w);
    context.font = "13px system-ui, sans-serif";
    context.fillText(value, x, y + h + 22, w);
  });
  return figure;
}

const escaped = (text: string) =>
  text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/"/g, "&quot;");

export const PLOT = { width: 860, height: 520 };
const EDGE = { left: 76, right: 220, top: 44, bottom: 62 };

/** A plot of the page as a figure for papers: on white, with its title, key and origin in it. */
export function plotSvg(plot: {
  title: string;
  origin: string;
  x: string;
  y: string;
  lines: readonly Line[];
  styles: Map<string, Style>;
  /** Where the horizontal axis has its ticks; round numbers unless given. */
  ticks?: readonly number[] | undefined;
}): string {
  const points = plot.lines.flatMap((l) => l.points.filter((p) => p.y > 0));
  const [x0, x1] = spread(points.map((p) => p.x));
  const [y0, y1] = spread(points.flatMap((p) => [p.y, p.high, Math.max(p.low, p.y / 2)]));
  const right = PLOT.width - EDGE.right;
  const bottom = PLOT.height - EDGE.bottom;
  const at = (v: number, low: number, high: number, from: number, to: number) =>
    (from + (Math.log(v / low) / Math.log(high / low)) * (to - from)).toFixed(1);
  const px = (v: number) => at(v, x0, x1, EDGE.left, right);
  const py = (v: number) => at(v, y0, y1, bottom, EDGE.top);
  const parts: string[] = [];
  const text = (x: number | string, y: number | string, words: string, more = "") =>
    parts.push(`<text x="${x}" y="${y}" ${more}>${escaped(words)}</text>`);
  parts.push(`<rect width="${PLOT.width}" height="${PLOT.height}" fill="#fff"/>`);
  for (const v of plot.ticks ?? logTicks(x0, x1)) {
    parts.push(`<path d="M${px(v)} ${EDGE.top}V${bottom}" stroke="#ddd"/>`);
    text(px(v), bottom + 18, plainTick(v), 'text-anchor="middle"');
  }
  for (const v of logTicks(y0, y1)) {
    parts.push(`<path d="M${EDGE.left} ${py(v)}H${right}" stroke="#ddd"/>`);
    text(EDGE.left - 8, Number(py(v)) + 4, plainTick(v), 'text-anchor="end"');
  }
  parts.push(
    `<rect x="${EDGE.left}" y="${EDGE.top}" width="${right - EDGE.left}" height="${bottom - EDGE.top}" fill="none" stroke="#444"/>`,
    `<clipPath id="inside"><rect x="${EDGE.left - 9}" y="${EDGE.top - 9}" width="${right - EDGE.left + 18}" height="${bottom - EDGE.top + 18}"/></clipPath>`,
  );
  text(EDGE.left, 24, plot.title, 'font-weight="600" font-size="15"');
  text((EDGE.left + right) / 2, bottom + 38, plot.x, 'text-anchor="middle"');
  text(EDGE.left, PLOT.height - 6, plot.origin, 'font-size="9.5" fill="#666"');
  const middle = (EDGE.top + bottom) / 2;
  text(18, middle, plot.y, `text-anchor="middle" transform="rotate(-90 18 ${middle})"`);
  plot.lines.forEach((line, i) => {
    const { colour, dash } = plot.styles.get(line.id)!;
    const stroke = `stroke="${colour}" stroke-dasharray="${dash.join(" ")}"`;
    const own = line.points.filter((p) => p.y > 0);
    parts.push(`<g clip-path="url(#inside)" data-method="${escaped(line.id)}">`);
    parts.push(
      `<polyline points="${own.map((p) => `${px(p.x)},${py(p.y)}`).join(" ")}" fill="none" ${stroke} stroke-width="2"/>`,
    );
    for (const p of own) {
      if (p.high > p.y)
        parts.push(
          `<path d="M${px(p.x)} ${py(p.high)}V${p.low > 0 ? py(p.low) : bottom}" stroke="${colour}" stroke-width="1.5"/>`,
        );
      parts.push(`<circle cx="${px(p.x)}" cy="${py(p.y)}" r="3.5" fill="${colour}"/>`);
      if (p.front)
        parts.push(
          `<circle class="front" cx="${px(p.x)}" cy="${py(p.y)}" r="7" fill="none" stroke="#000" stroke-width="1.5"/>`,
        );
    }
    parts.push("</g>");
    const y = EDGE.top + 8 + 18 * i;
    parts.push(
      `<path d="M${right + 14} ${y}h26" ${stroke} stroke-width="2"/><circle cx="${right + 27}" cy="${y}" r="3.5" fill="${colour}"/>`,
    );
    text(right + 46, y + 4, line.name);
  });
  if (plot.lines.some((l) => l.points.some((p) => p.front))) {
    const y = EDGE.top + 8 + 18 * plot.lines.length;
    parts.push(`<circle cx="${right + 27}" cy="${y}" r="7" fill="none" stroke="#000" stroke-width="1.5"/>`);
    text(right + 46, y + 4, "Pareto front");
  }
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${PLOT.width}" height="${PLOT.height}" viewBox="0 0 ${PLOT.width} ${PLOT.height}" font-family="system-ui, sans-serif" font-size="12" fill="#111">${parts.join("\n")}</svg>\n`;
}
