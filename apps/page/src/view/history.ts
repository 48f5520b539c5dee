/** The states that undo and redo lead to. */
export class History<T> {
  private past: T[] = [];
  private future: T[] = [];
  private step: string | undefined;

  constructor(private present: T) {}

  get now(): T {
    return this.present;
  }
  get canUndo(): boolean {
    return this.past.length > 0;
  }
  get canRedo(): boolean {
    return this.future.length > 0;
  }

  /** @param step  changes in a row with one name, as those of a drag, are undone together */
  change(next: T, step?: string): void {
    if (next === this.present) return;
    if (step === undefined || step !== this.step) {
      this.past.push(this.present);
      if (this.past.length > 500) this.past.shift();
    }
    this.step = step;
    this.present = next;
    this.future = [];
  }

  /** The next change begins a step of its own. */
  endStep(): void {
    this.step = undefined;
  }

  undo(): void {
    this.move(this.past, this.future);
  }
  redo(): void {
    this.move(this.future, this.past);
  }

  private move(from: T[], to: T[]): void {
    if (from.length === 0) return;
    to.push(this.present);
    this.present = from.pop()!;
    this.step = undefined;
  }
}
