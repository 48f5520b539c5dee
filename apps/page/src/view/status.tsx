import { useEffect, useReducer } from "preact/hooks";
import { number } from "../format";
import { useViewer } from "./context";
import { secondsLeft, timeText } from "./progress";
import { useTopic } from "./topic";

/** Draws the component again while something goes on, so that its seconds do. */
function useClock(runs: boolean): void {
  const [, again] = useReducer((n: number) => n + 1, 0);
  useEffect(() => {
    if (!runs) return;
    const timer = setInterval(() => again(undefined), 250);
    return () => clearInterval(timer);
  }, [runs]);
}

/** How far the picture is, and what it lacks. */
export function Status() {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const { progress, link, scene, told } = viewer;
  const picture = viewer.shown(viewer.settings.layer)?.picture;
  const stage = progress?.stage ?? (picture?.full ? "done" : "waiting for a picture");
  const stopped = stage === "done" || stage === "elsewhere" || !!viewer.problem;
  const works = link === "open" && !stopped;
  useClock(works);
  const now = performance.now();
  const passed = (progress?.seconds ?? 0) + (works ? (now - told.at) / 1000 : 0);
  const share = progress?.share ?? undefined;
  const left = works && share !== undefined ? secondsLeft(told, share, now) : undefined;
  const lacks = picture?.stage === "predicted" ? (scene?.left_out ?? []) : [];
  const counts = works && !!progress?.goal;
  return (
    <div class="status">
      <span class={`stage-name${works ? " works" : ""}`} data-stage={stage}>
        <i aria-hidden="true" />
        {viewer.problem ? "stopped by a problem" : (WORDS[stage] ?? stage)}
      </span>
      {stage === "elsewhere" && (
        <button type="button" class="resume" onClick={() => viewer.resume()}>
          Go on here
        </button>
      )}
      {works && (
        <progress max={1} {...(share !== undefined ? { value: share } : {})} aria-label={`Share of ${stage} that is done`} />
      )}
      {counts && (
        <span class="counts">
          <b>{progress?.samples ?? 0}</b> of {progress?.goal} spp
        </span>
      )}
      {left !== undefined && <span class="left">{timeText(left)} left</span>}
      {progress?.seconds !== undefined && <span class="passed">{timeText(passed)}</span>}
      {picture && !viewer.ofFrames && (
        <span class={`kind ${picture.stage}`} title={KINDS[picture.stage]}>
          {picture.stage === "predicted"
            ? picture.full
              ? "shown: predicted"
              : "shown: predicted, coarse"
            : `shown: path traced, cleaned, ${picture.samples} spp`}
        </span>
      )}
      {picture && !viewer.ofFrames && picture.stage === "clean" && picture.error !== null && (
        <span title="Estimated relative error of the picture">
          error <b>{number(100 * picture.error)} %</b>
        </span>
      )}
      {picture && (
        <span class="size">
          {picture.width} × {picture.height}
        </span>
      )}
      {lacks.length > 0 && (
        <span class="lacks" title={lacks.join("\n")}>
          without {lacks.join(", ")}
        </span>
      )}
    </div>
  );
}

const WORDS: Record<string, string> = {
  marching: "predicting",
  elsewhere: "paused: another page of this program is being computed",
};

const KINDS = {
  predicted: "Computed without random numbers from a light field: shown until there are samples",
  clean: "Path traced and denoised",
};
