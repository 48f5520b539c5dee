import { useEffect, useReducer } from "preact/hooks";

/** Something that changes, and who wants to know. */
export class Topic {
  private readonly listeners = new Set<() => void>();

  subscribe(listener: () => void): () => void {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  emit(): void {
    for (const listener of this.listeners) listener();
  }
}

/** Draws the component again when the topic changes. */
export function useTopic(topic: Topic): void {
  const [, again] = useReducer((n: number) => n + 1, 0);
  useEffect(() => topic.subscribe(() => again(undefined)), [topic]);
}
