import { useEffect, useRef, useState } from "preact/hooks";

/** Few significant digits, as many as there is room for. */
export function shortNumber(value: number, digits = 5): string {
  return Number.isFinite(value) ? String(Number(value.toPrecision(digits))) : "";
}

/** A number to type; the up and down arrow keys and the wheel step it, with Shift a tenth as far. What is not a number is not taken. */
export function NumberInput(props: {
  label: string;
  help?: string | undefined;
  value: number;
  lowest?: number | null | undefined;
  highest?: number | null | undefined;
  integer?: boolean;
  /** Significant digits that are printed. */
  digits?: number;
  /** What an arrow key adds, or a notch of the wheel. */
  step: number;
  id?: string;
  disabled?: boolean;
  onChange: (value: number) => void;
}) {
  const [draft, setDraft] = useState<string | undefined>();
  const fit = (value: number) => {
    const within = Math.min(props.highest ?? Infinity, Math.max(props.lowest ?? -Infinity, value));
    return props.integer ? Math.round(within) : within;
  };
  const take = (text: string) => {
    setDraft(undefined);
    const value = Number(text.replace(",", "."));
    if (text.trim() !== "" && Number.isFinite(value) && fit(value) !== props.value) props.onChange(fit(value));
  };
  const by = (steps: number, fine: boolean) => {
    setDraft(undefined);
    const step = props.integer ? 1 : props.step * (fine ? 0.1 : 1);
    props.onChange(fit(Number((props.value + steps * step).toPrecision(9))));
  };
  const input = useRef<HTMLInputElement>(null);
  const latest = useRef(by);
  latest.current = by;
  useEffect(() => {
    const element = input.current!;
    const wheel = (event: WheelEvent) => {
      if (document.activeElement !== element) return;
      event.preventDefault();
      latest.current(-Math.sign(event.deltaY || event.deltaX), event.shiftKey);
    };
    element.addEventListener("wheel", wheel, { passive: false });
    return () => element.removeEventListener("wheel", wheel);
  }, []);
  return (
    <input
      ref={input}
      type="text"
      class="number"
      inputMode="decimal"
      autocomplete="off"
      spellcheck={false}
      id={props.id}
      aria-label={props.label}
      title={props.help}
      disabled={props.disabled}
      value={draft ?? shortNumber(props.value, props.digits)}
      onInput={(e) => setDraft(e.currentTarget.value)}
      onChange={(e) => take(e.currentTarget.value)}
      onBlur={() => setDraft(undefined)}
      onKeyDown={(e) => {
        if (e.key === "Escape") setDraft(undefined);
        if (e.key !== "ArrowUp" && e.key !== "ArrowDown") return;
        e.preventDefault();
        by(e.key === "ArrowUp" ? 1 : -1, e.shiftKey);
      }}
    />
  );
}
