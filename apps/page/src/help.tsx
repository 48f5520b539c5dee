import type { ComponentChildren, RefObject } from "preact";

export interface PrintedKeys {
  keys: readonly string[];
  /** How the keys are printed, where their names are not. */
  print?: string;
  /** What they do; empty: not listed. */
  what: string;
}

/** The dialog itself knows whether it is open: showModal() opens it before the next key comes. */
export function Help(props: {
  dialog: RefObject<HTMLDialogElement | null>;
  groups: readonly { group: string; bindings: readonly PrintedKeys[] }[];
  note: ComponentChildren;
}) {
  const { dialog, groups, note } = props;
  const close = () => dialog.current!.close();
  return (
    <dialog
      ref={dialog}
      class="help"
      aria-labelledby="help-title"
      onClick={(e) => e.target === dialog.current && close()}
    >
      <header>
        <h2 id="help-title">Keys</h2>
        <button type="button" onClick={close}>
          Close
        </button>
      </header>
      <div class="groups">
        {groups.map(({ group, bindings }) => (
          <section key={group}>
            <h3>{group}</h3>
            <dl>
              {bindings
                .filter((b) => b.what)
                .map((b) => (
                  <div key={b.what}>
                    <dt>
                      {(b.print ?? b.keys[0]!.toUpperCase())
                        .split(" ")
                        .map((k) => (k === "+" && b.print !== "+" ? " + " : <kbd key={k}>{k}</kbd>))}
                    </dt>
                    <dd>{b.what}</dd>
                  </div>
                ))}
            </dl>
          </section>
        ))}
      </div>
      <p class="note">{note}</p>
    </dialog>
  );
}
