// What each layer is worth to each filter: left out, and alone.
import { usePage } from "./context";
import { Section } from "./controls";
import { number, percent } from "./format";
import { measuredMethods, nearest } from "./state";

export function AblationView() {
  const { index, view, name } = usePage();
  const metric = index.metrics.get(view.metric);
  const measured = index.results.ablation.filter(
    (a) => a.scene === view.scene && a.region === view.region && a.metrics[view.metric],
  );
  const spp = nearest(
    measured.map((a) => a.spp),
    view.spp,
  );
  const entries = measured.filter((a) => a.spp === spp);
  const methods = measuredMethods(index, view, entries);
  if (methods.length === 0)
    return (
      <p class="empty">
        No layer was left out for {view.scene}: {metric?.name}, {view.region}.
      </p>
    );
  const over = `${metric?.name ?? view.metric}, ${view.scene}, ${spp} spp, ${view.region === "medium" ? "pixels of the medium" : "whole frame"}`;
  return (
    <div class="ablation">
      {(["without", "alone"] as const).map((how) => {
        const of = entries.filter((a) => a.how === how && methods.includes(a.method));
        const layers = [...new Set(of.map((a) => a.layer))];
        if (layers.length === 0) return null;
        return (
          <Section
            key={how}
            title={how === "without" ? "Each layer left out" : "Each layer alone"}
            note={`${over}. Change against the same filter with all its layers; ${metric?.better === "higher" ? "below" : "above"} zero the error has grown.`}
          >
            <div
              class="scroll"
              tabIndex={0}
              role="region"
              aria-label={how === "without" ? "Layers left out" : "Layers alone"}
            >
              <table class="matrix heat">
                <thead>
                  <tr>
                    <th scope="col">{how === "without" ? "without" : "only"}</th>
                    {layers.map((l) => (
                      <th key={l} scope="col">
                        <span>{l}</span>
                      </th>
                    ))}
                    <th scope="col">
                      <span>all layers</span>
                    </th>
                  </tr>
                </thead>
                <tbody>
                  {methods
                    .filter((id) => of.some((a) => a.method === id))
                    .map((id) => {
                      const full = index.estimate(view.scene, spp, id, view.region, view.metric);
                      return (
                        <tr key={id}>
                          <th scope="row">{name(id)}</th>
                          {layers.map((layer) => {
                            const e = of.find((a) => a.method === id && a.layer === layer)?.metrics[view.metric];
                            if (!e) return <td key={layer} class="none" />;
                            if (!full?.mean) return <td key={layer}>{number(e.mean)}</td>;
                            const change = Math.abs(e.mean) / Math.abs(full.mean) - 1;
                            const worse = (metric?.better === "higher" ? -1 : 1) * change;
                            const strength = Math.round(55 * Math.min(1, Math.abs(worse) / 0.5));
                            return (
                              <td
                                key={layer}
                                title={`${number(e.mean)}${e.half_width ? ` ± ${number(e.half_width)}` : ""} instead of ${number(full.mean)}`}
                                style={{
                                  background: `color-mix(in oklab, var(${worse > 0 ? "--worse" : "--better"}) ${strength}%, transparent)`,
                                }}
                              >
                                {percent(change)}
                              </td>
                            );
                          })}
                          <td class="count">{number(full?.mean)}</td>
                        </tr>
                      );
                    })}
                </tbody>
              </table>
            </div>
          </Section>
        );
      })}
    </div>
  );
}
