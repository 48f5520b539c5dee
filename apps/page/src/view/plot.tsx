// The histogram of the shown layer.
import { useEffect, useRef } from "preact/hooks";
import { EMBER } from "../color";
import { useViewer } from "./context";
import { histogram, log2OfPositive } from "./histogram";
import { useTopic } from "./topic";

const WIDTH = 288;
const HEIGHT = 64;
const BINS = 96;
/** Stops from display white at the scene's own exposure. */
const STOPS = [-12, 6] as const;

export function HistogramPlot() {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const canvas = useRef<HTMLCanvasElement>(null);
  const drawn = viewer.shown(viewer.settings.layer);
  const { stops } = viewer.settings;
  const plain = drawn?.picture.channels === 1;

  useEffect(() => {
    const context = canvas.current!.getContext("2d")!;
    context.setTransform(2, 0, 0, 2, 0, 0);
    context.clearRect(0, 0, WIDTH, HEIGHT);
    if (!drawn) return;
    const [low, high] = plain ? drawn.range : STOPS;
    const values = plain ? drawn.values : log2OfPositive(drawn.values, drawn.picture.exposure);
    const shares = histogram(values, low, high, BINS);
    // A few bins that hold almost everything would flatten all others.
    const highest = Math.max(1e-6, [...shares].sort((a, b) => b - a)[2]!);
    const place = (v: number) => ((v - low) / (high - low)) * WIDTH;
    if (!plain)
      for (let stop = low + 2; stop < high; stop += 2) {
        context.fillStyle = "#ffffff14";
        context.fillRect(Math.round(place(stop)), 0, 1, HEIGHT);
      }
    const white = plain ? Infinity : -stops;
    for (let i = 0; i < BINS; ++i) {
      const height = Math.min(1, shares[i]! / highest) * (HEIGHT - 4);
      const at = 3 * Math.round((255 * i) / (BINS - 1));
      const value = low + ((i + 0.5) / BINS) * (high - low);
      context.fillStyle = plain
        ? `rgb(${EMBER[at]}, ${EMBER[at + 1]}, ${EMBER[at + 2]})`
        : value > white
          ? "#ffb066"
          : "#9fb4c8";
      context.fillRect((i * WIDTH) / BINS, HEIGHT - height, WIDTH / BINS - 0.5, height);
    }
    if (!plain) {
      context.fillStyle = "#fff";
      context.fillRect(Math.round(place(white)) - 1, 0, 2, HEIGHT);
    }
  }, [drawn, stops]);

  return (
    <figure class="histogram">
      <canvas
        ref={canvas}
        width={2 * WIDTH}
        height={2 * HEIGHT}
        role="img"
        aria-label={plain ? "Histogram of the layer's values" : "Histogram of luminance, in stops from white"}
      />
      <figcaption>{plain ? "values" : "log luminance: a line every 2 stops, the bright one is white"}</figcaption>
    </figure>
  );
}
