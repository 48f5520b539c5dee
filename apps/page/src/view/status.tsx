import { number, seconds } from "../format";
import { useViewer } from "./context";
import { useTopic } from "./topic";

/** How far the picture is, and what it lacks. */
export function Status() {
  const viewer = useViewer();
  useTopic(viewer.arrived);
  const { progress, link, scene } = viewer;
  const picture = viewer.shown(viewer.settings.layer)?.picture;
  const stage = progress?.stage ?? (picture ? "done" : "waiting for a picture");
  const works = link === "open" && stage !== "done";
  const error = progress?.error ?? picture?.error;
  const samples = progress?.samples ?? picture?.samples ?? 0;
  const lacks = picture?.stage === "predicted" ? (scene?.left_out ?? []) : [];
  return (
    <div class="status">
      <span class={`stage-name${works ? " works" : ""}`} data-stage={stage}>
        <i aria-hidden="true" />
        {stage}
      </span>
      {picture && (
        <span class={`kind ${picture.stage}`} title={KINDS[picture.stage]}>
          {picture.stage === "predicted" ? "predicted" : "path traced, cleaned"}
        </span>
      )}
      {samples > 0 && (
        <span>
          <b>{samples}</b> spp
        </span>
      )}
      {error !== null && error !== undefined && (
        <span title="Estimated relative error of the picture">
          error <b>{number(100 * error)} %</b>
        </span>
      )}
      {progress?.seconds !== undefined && <span>{seconds(progress.seconds)}</span>}
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

const KINDS = {
  predicted: "Computed without random numbers from a light field: shown while the scene moves",
  clean: "Path traced and denoised",
};
