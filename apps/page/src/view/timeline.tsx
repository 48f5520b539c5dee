import { useViewer } from "./context";
import { Icon } from "./icons";
import { NumberInput } from "./number_input";
import { useTopic } from "./topic";

/** The frames of a sequence. */
export function Timeline() {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const frames = viewer.scene?.frames;
  if (!frames || frames.length < 2) return null;
  const shown = viewer.shownFrame ?? frames[0]!;
  const at = Math.max(0, frames.indexOf(shown));
  const nearest = (frame: number) =>
    frames.reduce((best, f) => (Math.abs(f - frame) < Math.abs(best - frame) ? f : best));
  return (
    <div class="timeline" role="group" aria-label="Time line">
      <button
        type="button"
        class="icon"
        title={viewer.playing ? "Pause (Space)" : "Play (Space)"}
        aria-label={viewer.playing ? "Pause" : "Play"}
        onClick={() => viewer.togglePlay()}
      >
        <Icon name={viewer.playing ? "pause" : "play"} />
      </button>
      <input
        type="range"
        min={0}
        max={frames.length - 1}
        step={1}
        value={at}
        aria-label="Frame"
        aria-valuetext={`frame ${shown}`}
        onInput={(e) => viewer.goTo(frames[Number(e.currentTarget.value)]!, true)}
        onChange={() => viewer.settle()}
      />
      <NumberInput
        label="Frame number"
        value={shown}
        lowest={frames[0]}
        highest={frames[frames.length - 1]}
        integer
        step={1}
        onChange={(frame) => viewer.goTo(nearest(frame))}
      />
      <span class="of">/ {frames[frames.length - 1]}</span>
    </div>
  );
}
