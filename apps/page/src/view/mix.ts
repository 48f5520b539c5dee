// How light groups are mixed. The factors stand among the page's assignments, as mix.GROUP, so that undo, redo and reset
// know them; what is sent as assignments of the scene lacks them.
import { assigned, dropped, type Assignments } from "./assignments";
import { channels } from "./field_info";
import type { Vec3 } from "./vector";

const TABLE = "mix";

export function mixKey(group: string): string {
  return `${TABLE}.${group}`;
}

export function isMixed(all: Assignments): boolean {
  for (const key of all.keys()) if (key.startsWith(`${TABLE}.`)) return true;
  return false;
}

/** What a group's light is multiplied by, by colour. */
export function factorOf(all: Assignments, group: string): Vec3 {
  return channels(all.get(mixKey(group)) ?? 1);
}

export function mixed(all: Assignments, group: string, factor: readonly number[]): Assignments {
  const key = mixKey(group);
  return factor.every((f) => f === 1) ? dropped(all, key) : assigned(all, key, factor);
}

export function withoutMix(all: Assignments): Assignments {
  return dropped(all, TABLE);
}

/** As a message has it. @param groups  of the scene: others are left out; nothing where they are not known yet */
export function mixOf(all: Assignments, groups: readonly string[] | undefined): Record<string, Vec3> | undefined {
  const mix: Record<string, Vec3> = {};
  for (const key of all.keys()) {
    if (!key.startsWith(`${TABLE}.`)) continue;
    const group = key.slice(TABLE.length + 1);
    if (!groups || groups.includes(group)) mix[group] = factorOf(all, group);
  }
  return Object.keys(mix).length ? mix : undefined;
}

/** Assignments of the scene's lights, as the program gives them for a mix, in the place of the mix. */
export function mixTaken(all: Assignments, lights: readonly string[]): Assignments {
  let result = withoutMix(all);
  for (const light of lights) {
    const equals = light.indexOf("=");
    result = assigned(result, light.slice(0, equals), JSON.parse(light.slice(equals + 1)) as number | number[]);
  }
  return result;
}
