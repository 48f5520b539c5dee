// The page's state: what it changes in the scene's file, as a list of assignments by key. Resetting a field takes its
// assignment away.

export type Value = number | boolean | string | readonly Value[] | { readonly [key: string]: Value };
export type Assignments = ReadonlyMap<string, Value>;

export const NONE: Assignments = new Map();

/** A value as TOML writes it. */
export function toml(value: Value): string {
  if (typeof value === "number")
    return Number.isFinite(value) ? String(value).replace("e+", "e") : value > 0 ? "inf" : value < 0 ? "-inf" : "nan";
  if (typeof value === "string") return JSON.stringify(value).replace(/\x7f/g, "\\u007f");
  if (typeof value === "boolean") return String(value);
  if (isList(value)) return `[${value.map(toml).join(",")}]`;
  return `{${Object.entries(value)
    .map(([key, v]) => `${key}=${toml(v)}`)
    .join(",")}}`;
}

function isList(value: Value): value is readonly Value[] {
  return Array.isArray(value);
}

export function assigned(all: Assignments, key: string, value: Value): Assignments {
  return new Map(all).set(key, value);
}

/** Takes away the assignments of a key and of everything in it. */
export function dropped(all: Assignments, key: string): Assignments {
  return new Map([...all].filter(([k]) => k !== key && !k.startsWith(`${key}.`)));
}

/** A key's value, also where the table that holds it is assigned as a whole. */
export function lookUp(all: Assignments, key: string): Value | undefined {
  const value = all.get(key);
  if (value !== undefined) return value;
  const dot = key.lastIndexOf(".");
  const table = dot > 0 ? all.get(key.slice(0, dot)) : undefined;
  return table !== undefined && typeof table === "object" && !isList(table) ? table[key.slice(dot + 1)] : undefined;
}

/** Whether something in a table is assigned, or all of it. */
export function touches(all: Assignments, table: string): boolean {
  for (const key of all.keys()) if (key === table || key.startsWith(`${table}.`)) return true;
  return false;
}

/** Takes a light away that an assignment added: those added after it move up by one. */
export function lightRemoved(all: Assignments, index: number): Assignments {
  const result = new Map<string, Value>();
  for (const [key, value] of all) {
    const match = /^lights\.(\d+)(.*)$/.exec(key);
    const place = match ? Number(match[1]) : -1;
    if (place === index) continue;
    result.set(place > index ? `lights.${place - 1}${match![2]}` : key, value);
  }
  return result;
}

/** As the program's option -D takes them. */
export function asSet(all: Assignments): string[] {
  return [...all].map(([key, value]) => `${key}=${toml(value)}`);
}
