import type { RefObject } from "preact";
import { BINDINGS } from "./keys";

/** The dialog itself knows whether it is open: showModal() opens it before the next key comes. */
export function Help({ dialog }: { dialog: RefObject<HTMLDialogElement | null> }) {
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
        {BINDINGS.map(({ group, bindings }) => (
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
      <p class="note">
        With a pointer: the wheel or two fingers zoom, a drag moves the picture, or the divider while the whole picture
        is seen; a double click zooms in and out.
      </p>
    </dialog>
  );
}
