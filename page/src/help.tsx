import { useEffect, useRef } from "preact/hooks";
import { BINDINGS } from "./keys";

export function Help({ open, onClose }: { open: boolean; onClose: () => void }) {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (open && !dialog.current!.open) dialog.current!.showModal();
    if (!open && dialog.current!.open) dialog.current!.close();
  }, [open]);
  return (
    <dialog
      ref={dialog}
      class="help"
      aria-labelledby="help-title"
      onClose={onClose}
      onClick={(e) => e.target === dialog.current && onClose()}
    >
      <header>
        <h2 id="help-title">Keys</h2>
        <button type="button" onClick={onClose}>
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
