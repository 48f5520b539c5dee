// The divider between two pictures, moved with the keyboard; pointers drag it through the pane below it.
export function Divider({ label, split, onStep }: { label: string; split: number; onStep: (by: number) => void }) {
  const percent = Math.round(100 * split);
  const step = (event: KeyboardEvent) => {
    const by = { ArrowLeft: -0.02, ArrowRight: 0.02, PageUp: 0.2, PageDown: -0.2, Home: -1, End: 1 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    onStep(by);
  };
  return (
    <div
      class="divider"
      role="separator"
      tabIndex={0}
      aria-orientation="vertical"
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={percent}
      style={{ left: `${100 * split}%` }}
      onKeyDown={step}
    >
      <svg viewBox="0 0 34 34" aria-hidden="true">
        <path d="M13 12l-5 5 5 5M21 12l5 5-5 5" />
      </svg>
    </div>
  );
}
