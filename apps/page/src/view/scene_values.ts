// The values of the scene's fields: those that the page assigns at once, all others as the program told them last.
import { lookUp, type Assignments, type Value } from "./assignments";
import { distance, framed, seenFrom, type Camera } from "./camera";
import type { Field, Group, SceneMessage } from "./protocol";
import { length, sub, type Vec3 } from "./vector";

export class SceneValues {
  /** Values of the file, for fields that were seen without an assignment. */
  private readonly file = new Map<string, Value>();
  private readonly fields = new Map<string, Field>();
  message: SceneMessage | undefined;

  /** @param assignments  those in force in the message; nothing where they are not known */
  take(message: SceneMessage, assignments: Assignments | undefined): void {
    if (message.reloaded) this.file.clear();
    this.fields.clear();
    this.message = message;
    for (const group of message.groups)
      for (const field of group.fields) {
        const key = `${group.path}.${field.key}`;
        this.fields.set(key, field);
        if (assignments ? lookUp(assignments, key) === undefined : !this.file.has(key)) this.file.set(key, field.value);
      }
  }

  groups(kind: string): Group[] {
    return (this.message?.groups ?? []).filter(({ path }) => path === kind || path.startsWith(`${kind}.`));
  }

  /** What people call a table: its file or type, with a number where others are called so too. */
  title(path: string): string {
    const [list, index] = path.split(".");
    if (index === undefined) return path;
    const title = (group: Group) => group.title || group.path;
    const all = this.groups(list!);
    const own = all.find((group) => group.path === path);
    if (!own) return path;
    const same = all.filter((group) => title(group) === title(own));
    return same.length > 1 ? `${title(own)} ${same.indexOf(own) + 1}` : title(own);
  }

  field(key: string): Field | undefined {
    return this.fields.get(key);
  }

  /** The value with the page's assignments. */
  value(assignments: Assignments, key: string): Value | undefined {
    return lookUp(assignments, key) ?? this.file.get(key) ?? this.fields.get(key)?.value;
  }

  /** The value without the page's assignment: of the file, or of a table that an assignment added. */
  unchanged(key: string): Value | undefined {
    return this.file.get(key);
  }

  camera(assignments: Assignments): Camera | undefined {
    if (!this.message) return undefined;
    const of = <T>(key: string, otherwise: T) =>
      (this.value(assignments, `camera.${key}`) as T | undefined) ?? otherwise;
    const camera: Camera = {
      type: of<Camera["type"]>("type", "perspective"),
      position: of<Vec3>("position", [0, 0, 0]),
      look_at: of<Vec3>("look_at", [0, 0, 0]),
      up: of<Vec3>("up", [0, 0, 1]),
      fov: of("fov", 40),
      width: of("width", 1),
      fov_axis: of<Camera["fov_axis"]>("fov_axis", "x"),
      lens_radius: of("lens_radius", 0),
      focus_distance: of("focus_distance", 0),
    };
    // One that keys or a file place has no place of its own.
    const [low, high] = this.message.bounds ?? [camera.look_at, camera.look_at];
    if (distance(camera) > 0 || !(length(sub(high, low)) > 0)) return camera;
    return framed(seenFrom(camera, "front"), [low, high], 1);
  }
}
