// How long something still takes.

/** Seconds until a stage is done at its pace so far; nothing while it is too early to tell.
 *  @param told  when the stage began [ms], and the share of it that was done then */
export function secondsLeft(told: { began: number; share: number }, share: number, now: number): number | undefined {
  const [seconds, done] = [(now - told.began) / 1000, share - told.share];
  if (seconds < 1 || done < 0.02 || share >= 1) return undefined;
  return (seconds * (1 - share)) / done;
}

/** As a person reads it: "12 s", "2 min 05 s". */
export function timeText(seconds: number): string {
  if (seconds < 9.95) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
  return `${Math.floor(whole / 3600)} h ${String(Math.floor((whole % 3600) / 60)).padStart(2, "0")} min`;
}
