// The answer before all details: which method is the best over all scenes, among those that are quick, without guides.
import { usePage } from "./context";
import { breakable, bytes, number, seconds, times } from "./format";
import type { Index, Overall, OverallMethod } from "./results";
import { bestShown, shownMethods, type View } from "./state";

/** Seconds of guides and filter on a frame within which an answer is wanted soon. */
const QUICK = 0.5;

interface Question {
  id: string;
  title: string;
  takes: (m: OverallMethod) => boolean;
}

const QUESTIONS: Question[] = [
  { id: "best", title: "Best over all scenes", takes: () => true },
  { id: "quick", title: "Best under half a second", takes: (m) => m.most_seconds < QUICK },
  { id: "plain", title: "Best without guides", takes: (m) => !m.guides },
];

export interface Found {
  question: Question;
  best: OverallMethod | undefined;
  /** What the seeds cannot tell from it. */
  level: string[];
}

/** An answer to each question among the methods that are shown. */
export function answers(overall: Overall, shown: readonly string[]): Found[] {
  return QUESTIONS.map((question) => {
    const fitting = overall.methods.filter((m) => shown.includes(m.method) && question.takes(m));
    const best = fitting[0];
    return { question, best, level: fitting.map((m) => m.method).filter((id) => best?.level_with.includes(id)) };
  });
}

/** Questions with the same answer stand together. */
export function together(found: readonly Found[]): (Omit<Found, "question"> & { questions: Question[] })[] {
  const groups: (Omit<Found, "question"> & { questions: Question[] })[] = [];
  for (const { question, best, level } of found) {
    const same = groups.find((g) => g.best === best && g.level.join() === level.join());
    if (same) same.questions.push(question);
    else groups.push({ questions: [question], best, level });
  }
  return groups;
}

/** A place where the references are noisier than the best of the shown methods. */
export interface NoisyReference {
  scene: string;
  spp: number;
  metric: string;
  noise: number;
  method: string;
  error: number;
}

/** By the metric of the view; where the noise of that is not known, by Lab RMS. */
export function noisyReferences(index: Index, view: View): NoisyReference[] {
  const found: NoisyReference[] = [];
  for (const { name: scene, reference_errors } of index.results.scenes) {
    const noises = reference_errors?.[view.region] ?? {};
    const metric = view.metric in noises ? view.metric : "lab_rms";
    const noise = noises[metric];
    if (noise === undefined) continue;
    const higher = index.metrics.get(metric)?.better === "higher";
    for (const spp of index.spp(scene)) {
      const method = bestShown(index, { ...view, scene, spp, metric });
      if (method === undefined) continue;
      const error = index.estimate(scene, spp, method, view.region, metric)!.mean;
      if (higher ? noise < error : noise > error) found.push({ scene, spp, metric, noise, method, error });
    }
  }
  return found;
}

export function Answer() {
  const { index, view, set, name } = usePage();
  const shown = shownMethods(index, view);
  const overall = index.overall(view.region, view.metric, view.setting);
  const metric = index.metrics.get(view.metric);
  if (!overall)
    return metric && index.results.overall.length > 0 ? (
      <section class="answer" aria-label="Overall">
        <p class="note">
          {metric.better === "zero"
            ? `No method is the best over all scenes by ${metric.name}: values of opposite signs have no useful mean. Choose another metric.`
            : `${metric.name} was not measured over these pixels in any scene.`}
        </p>
      </section>
    ) : null;
  const over = `${overall.scenes.join(", ")} at ${overall.spp.join(", ")} spp`;
  const found = together(answers(overall, shown));
  const leftOut = overall.left_out.filter((l) => shown.includes(l.method));
  return (
    <section class="answer" aria-label="Overall">
      <div class="answers">
        {found.map(({ questions, best, level }) => (
          <div
            key={questions[0]!.id}
            class="one"
            data-question={questions.map((q) => q.id).join(" ")}
            data-method={best?.method}
          >
            <h2>{[questions[0]!.title, ...questions.slice(1).map((q) => q.title.toLowerCase())].join("; ")}</h2>
            {best ? (
              <>
                <p class="which">
                  <button
                    type="button"
                    title={`Look at ${name(best.method)} as B`}
                    onClick={() => set({ tab: "look", b: best.method })}
                  >
                    {breakable(name(best.method))}
                  </button>
                </p>
                <p>
                  {metric?.name} <b>{number(best.value)}</b>
                  {best.times_less_than_noisy && best.seconds > 0 && (
                    <>, {times(best.times_less_than_noisy)} times less than path tracing</>
                  )}
                </p>
                <p>
                  {best.seconds > 0 ? <b>{seconds(best.seconds)}</b> : "nothing beside rendering"}
                  {best.most_seconds > 0 && ` a frame, at most ${seconds(best.most_seconds)}`}
                  {best.most_memory_bytes ? `; ${bytes(best.most_memory_bytes)}` : ""}
                </p>
                {level.length > 0 && (
                  <p class="level">Level with it within the noise of the seeds: {level.map(name).join(", ")}</p>
                )}
              </>
            ) : (
              <p>None of the methods that are listed.</p>
            )}
          </div>
        ))}
      </div>
      <Warnings />
      <details class="note">
        <summary>
          {overall.mean === "geometric" ? "Geometric means" : "Means"} over {over},{" "}
          {view.region === "medium" ? "pixels of the medium" : "whole frame"}
          {view.setting && `, ${view.setting} parameters`}
          {view.hidden.length > 0 && ", among the methods that are ticked"}
          {overall.seeds === 1 && "; one seed: what is level within its noise cannot be told"}
          {leftOut.length > 0 && `, without ${leftOut.map((l) => name(l.method)).join(", ")}`}
        </summary>
        Seconds and memory are of guides and filter; rendering comes on top.{" "}
        {overall.seeds > 1 && `Level: not told apart by paired differences over ${overall.seeds} seeds (5 % level).`}
        {leftOut.length > 0 &&
          ` Without a number everywhere, and so in no mean: ${leftOut.map((l) => `${name(l.method)} (${l.why})`).join("; ")}.`}
      </details>
    </section>
  );
}

/** What readers must know of the references. */
function Warnings() {
  const { index, view, name } = usePage();
  const noisy = noisyReferences(index, view);
  const single = index.results.scenes.filter((s) => s.references === 1).map((s) => s.name);
  const scenes = [...new Set(noisy.map((n) => n.scene))];
  const counts = (scene: string) =>
    noisy
      .filter((n) => n.scene === scene)
      .map((n) => n.spp)
      .join(", ");
  return (
    <>
      {noisy.length > 0 && (
        <details class="warning">
          <summary>
            <b>The reference is noisier than the best method</b>:{" "}
            {scenes.map((scene) => `${scene} at ${counts(scene)} spp`).join("; ")}
          </summary>
          <ul>
            {noisy.map((n) => (
              <li key={`${n.scene} ${n.spp}`}>
                {n.scene}, {n.spp} spp: {index.metrics.get(n.metric)?.name ?? n.metric} {number(n.noise)} of the
                references' mean, {number(n.error)} of {name(n.method)}
              </li>
            ))}
          </ul>
          Error maps, SSIM and FLIP show the reference's noise there; from the other numbers it is taken off by two
          independent references. More samples: <code>reference_spp</code> or <code>reference_noise</code> in the
          experiment's file.
        </details>
      )}
      {single.length > 0 && (
        <p class="warning" role="note">
          {single.join(", ")}: one reference, whose noise is in every error and cannot be told.
        </p>
      )}
    </>
  );
}
