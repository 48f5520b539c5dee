// The list of methods at the left: the best first, with what to compare and what to leave out.
import { usePage } from "./context";
import { Select } from "./controls";
import { breakable, bytes, number, seconds } from "./format";
import type { Style } from "./palette";
import { REFERENCE, settingOf, totalSeconds } from "./results";
import { listedMethods, settings } from "./state";

export function Methods({ styles }: { styles: Map<string, Style> }) {
  const { index, library, view, set, name } = usePage();
  const choices = settings(index);
  const listed = listedMethods(index, view);
  const metric = index.metrics.get(view.metric);
  const value = (id: string) => index.estimate(view.scene, view.spp, id, view.region, view.metric)?.mean;
  const largest = Math.max(...listed.map((id) => Math.abs(value(id) ?? 0)), Number.MIN_VALUE);
  const look = (which: "a" | "b", id: string) =>
    set({ tab: "look", [which]: id, ...(view.mode === "flip" ? { front: which } : {}) });
  const toggle = (id: string) =>
    set(({ hidden }) => ({ hidden: hidden.includes(id) ? hidden.filter((h) => h !== id) : [...hidden, id] }));

  return (
    <aside class="methods" aria-label="Methods">
      <div class="inner">
        <header>
          <h2>Methods</h2>
          {choices.length > 1 && (
            <Select
              label="Parameters"
              value={view.setting}
              values={[
                ...choices.map((s) => ({ value: s, text: `${s} parameters` })),
                { value: "", text: "all parameters" },
              ]}
              onChange={(setting) => set({ setting })}
            />
          )}
        </header>
        <div class="columns" aria-hidden="true">
          <span>{metric?.name}, seconds in all, memory</span>
          <span>compare</span>
        </div>
        <ul>
          {[REFERENCE, ...listed].map((id) => {
            const method = index.methods.get(id);
            const shown = !view.hidden.includes(id);
            const row = index.row(view.scene, view.spp, id, view.region);
            const failed = row?.failed;
            const picture = library.has(view.scene, view.spp, id);
            const v = value(id);
            const label = index.label(id);
            const setting = method && view.setting === "" ? settingOf(method) : "";
            return (
              <li key={id} data-method={id} class={`${id === view.a ? "is-a " : ""}${id === view.b ? "is-b" : ""}`}>
                {method ? (
                  <input
                    type="checkbox"
                    checked={shown}
                    style={{ accentColor: styles.get(id)?.colour }}
                    aria-label={`${name(id)} in grid, plots and tables`}
                    onChange={() => toggle(id)}
                  />
                ) : (
                  <span class="no-box" />
                )}
                <button
                  type="button"
                  class="what"
                  disabled={!picture}
                  title={failed ?? `Look at ${name(id)} as B`}
                  onClick={() => look("b", id)}
                >
                  <span class="label">
                    {breakable(label)}
                    {setting && <small> {setting}</small>}
                  </span>
                  {failed ? (
                    <span class="failed">failed</span>
                  ) : (
                    method && (
                      <span class="bar">
                        <i
                          style={{
                            width: `${(100 * Math.abs(v ?? 0)) / largest}%`,
                            background: styles.get(id)?.colour,
                          }}
                        />
                        <span class="number">{number(v)}</span>
                        <span class="cost">{seconds(totalSeconds(row?.seconds))}</span>
                        {!!row?.peak_memory_bytes && <span class="cost">{bytes(row.peak_memory_bytes)}</span>}
                      </span>
                    )
                  )}
                  {!method && <span class="faint">what rendering longer gives</span>}
                </button>
                {(["a", "b"] as const).map((which) => (
                  <button
                    key={which}
                    type="button"
                    class={`as ${which}`}
                    disabled={!picture}
                    aria-pressed={view[which] === id}
                    aria-label={`${name(id)} as ${which.toUpperCase()}`}
                    onClick={() => look(which, id)}
                  >
                    {which.toUpperCase()}
                  </button>
                ))}
              </li>
            );
          })}
        </ul>
        {listed.length > 0 && (
          <footer>
            <button type="button" onClick={() => set({ hidden: [] })} disabled={view.hidden.length === 0}>
              All
            </button>
            <button
              type="button"
              onClick={() => set({ hidden: listed.filter((id) => id !== view.a && id !== view.b) })}
            >
              Only A and B
            </button>
          </footer>
        )}
      </div>
    </aside>
  );
}
