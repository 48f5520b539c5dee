import type { ComponentChildren } from "preact";
import { useId } from "preact/hooks";
import { useViewer } from "./context";
import { Icon } from "./icons";

/** A part that opens and closes. */
export function Panel(props: {
  name: string;
  title: string;
  kind?: string;
  open: boolean;
  /** Beside the title. */
  side?: ComponentChildren;
  changed?: boolean;
  off?: boolean;
  children: ComponentChildren;
}) {
  const viewer = useViewer();
  const id = useId();
  const open = viewer.settings.open[props.name] ?? props.open;
  return (
    <section class={`panel${open ? " open" : ""}${props.off ? " off" : ""}`} data-panel={props.name}>
      <header>
        <h2>
          <button
            type="button"
            aria-expanded={open}
            aria-controls={id}
            onClick={() => viewer.set({ open: { ...viewer.settings.open, [props.name]: !open } })}
          >
            <Icon name="more" />
            <span class="title">{props.title}</span>
            {props.kind && <small>{props.kind}</small>}
            {props.changed && <i class="dot" title="Changed" />}
          </button>
        </h2>
        {props.side}
      </header>
      <div id={id} class="inside" hidden={!open}>
        {open && props.children}
      </div>
    </section>
  );
}
