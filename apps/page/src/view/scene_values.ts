// The values of the scene's fields: those that the page assigns at once, all others as the program told them last.
import { lookUp, type Assignments, type Value } from "./assignments";
import type { Camera } from "./camera";
import type { Field, Group, SceneMessage } from "./protocol";
import type { Vec3 } from "./vector";

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
    return {
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
  }
}
