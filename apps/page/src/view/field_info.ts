// Which fields of a table are used most, and how far their sliders go.
import type { Value } from "./assignments";
import type { Field } from "./protocol";

function phaseFields(phase: Value | undefined): string[] {
  if (phase === "mie") return ["droplet_diameter"];
  return phase === "fournier_forand" ? ["particle_index", "size_slope"] : ["g"];
}

/** The fields that matter for what the table's other fields say, most used first; all others come under "more". */
export function mainFields(path: string, value: (key: string) => Value | undefined): string[] {
  switch (path.split(".")[0]) {
    case "volumes": {
      const preset = value("preset");
      const medium =
        preset === "principled"
          ? ["density", "color", "absorption_color", "g"]
          : preset === "standard_volume"
            ? ["density", "scatter", "scatter_color", "transparent", "transparent_depth", "g"]
            : ["sigma_t", "density", "albedo", ...phaseFields(value("phase"))];
      const lobes = value("phase") === "two_lobes" ? ["g2", "lobe_weight"] : [];
      const named = (key: string) => typeof value(key) === "string" && value(key) !== "none" && value(key) !== "";
      const heat = named("temperature_grid")
        ? ["temperature_grid", "temperature_offset", "temperature_scale", "blackbody_intensity"]
        : ["temperature_grid"];
      const flame = named("flame_grid") ? ["flame_grid", "flame_intensity"] : [];
      const shape =
        value("shape") === "layer"
          ? ["base_height", "scale_height"]
          : value("shape") === "box" || value("shape") === "sphere"
            ? ["lo", "hi"]
            : ["grid"];
      return [...medium, ...lobes, "emission", ...heat, ...flame, ...shape];
    }
    case "lights":
      switch (value("type")) {
        case "sun":
          return ["direction", "irradiance", "angular_diameter"];
        case "sphere":
          return ["position", "radiance", "radius"];
        case "rectangle":
          return ["position", "radiance", "edge_x", "edge_y", "two_sided"];
        case "point":
          return ["position", "intensity"];
        case "spot":
          return ["position", "direction", "intensity", "cone_angle", "cone_softness"];
        default:
          return ["direction", "irradiance", "position", "radiance", "radius"];
      }
    case "environment": {
      const sky =
        value("sky") !== undefined && value("sky") !== "none" ? ["turbidity", "sun_direction", "sky_sun"] : [];
      const air = value("sky") === "atmosphere" ? ["altitude", "air", "metres_per_unit"] : [];
      return ["radiance", "sky", ...sky, ...air, ...(value("file") ? ["rotation"] : [])];
    }
    case "surfaces":
      return ["material", "albedo", ...(value("material") === "diffuse" ? [] : ["roughness", "ior"]), "radiance"];
    case "camera":
      return [
        "type",
        value("type") === "orthographic" ? "width" : "fov",
        "lens_radius",
        ...(Number(value("lens_radius")) > 0 ? ["focus_distance"] : []),
        "position",
        "look_at",
      ];
    case "film":
      return ["exposure"];
    default:
      return [];
  }
}

export function ordered(
  path: string,
  fields: readonly Field[],
  value: (key: string) => Value | undefined,
): { main: Field[]; more: Field[] } {
  // The switch stands in the panel's title, and the picture is as large as the window.
  const shown = fields.filter(
    ({ key }) => key !== "enabled" && !(path === "film" && (key === "width" || key === "height")),
  );
  const keys = mainFields(path, value);
  if (!keys.length) return { main: shown, more: [] };
  const main = keys.flatMap((key) => shown.filter((field) => field.key === key && !field.fixed));
  return { main, more: shown.filter((field) => !main.includes(field)) };
}

export interface SliderRange {
  lowest: number;
  highest: number;
  /** Equal ways are equal factors; the slider's left end is zero. */
  log: boolean;
}

const STEPS = 10000;
/** Of a slider: by an arrow key or the wheel, and with Shift. */
export const SLIDER_STEP = { coarse: STEPS / 100, fine: STEPS / 1000 };

/** What keys are called; others by their own words. */
const LABELS: Record<string, string> = {
  absorption_color: "absorption colour",
  albedo_grid: "albedo from grid",
  blackbody_intensity: "black-body strength",
  blackbody_law: "black-body law",
  blade_rotation: "aperture rotation",
  blades: "aperture blades",
  cell_size: "majorant cell size",
  color: "colour",
  convert_level_set: "level set becomes fog",
  density: "density factor",
  edge_x: "first edge",
  edge_y: "second edge",
  flame_grid: "flame from grid",
  flash_relief: "relief of the flash",
  fov: "angle of view",
  fov_axis: "side it spans",
  from_exr: "camera of an EXR",
  g: "anisotropy",
  g2: "anisotropy of lobe 2",
  hi: "upper corner",
  lo: "lower corner",
  index_offset: "offset of voxels",
  ior: "refractive index",
  keys: "camera path",
  lobe_weight: "share of lobe 2",
  look_at: "looks at",
  look_at_end: "looks at, at the end",
  lookup: "density look-ups",
  max_density: "limit of density",
  max_events: "most scatterings",
  object_to_world: "placement",
  object_to_world_end: "placement at the end",
  phase: "phase function",
  position_end: "position at the end",
  remap: "curve of densities",
  roulette_start: "roulette from scattering",
  scatter_color: "scattering colour",
  sigma_a: "absorption",
  sigma_s: "scattering",
  sigma_t: "extinction",
  sky_sun: "sun of the sky",
  spp: "samples per pixel",
  sun_direction: "towards the sun",
  temperature_grid: "temperature from grid",
  up: "up direction",
  up_end: "up at the end",
  velocity_grid: "velocity from grid",
};

/** A unit as it is printed; nothing for plain numbers. */
export function unitText(unit: string | undefined): string {
  return !unit || unit === "1" ? "" : unit.replace(/\^2/g, "²").replace(/\^3/g, "³");
}

/** A key in words. */
export function labelOf(key: string): string {
  return LABELS[key] ?? key.replace(/_/g, " ");
}

/** Ranges narrower than those the scene allows, of numbers that are hardly ever set beyond them. */
const USUAL: Record<string, SliderRange> = {
  fov: { lowest: 1, highest: 120, log: false },
  angular_diameter: { lowest: 0.01, highest: 90, log: true },
  cone_angle: { lowest: 1, highest: 179, log: false },
  rotation: { lowest: -180, highest: 180, log: false },
  blade_rotation: { lowest: -180, highest: 180, log: false },
};

/** The slider of a number, or of a colour's strength; nothing where no range suggests itself.
 *  @param middle  the value of the scene's file   @param value  as it is now; the slider reaches it */
export function sliderRange(field: Field, middle: number, value = middle): SliderRange | undefined {
  if (field.type !== "number" && field.type !== "color") return undefined;
  const usual = USUAL[field.key];
  if (usual) return usual;
  const lowest = field.lowest ?? -Infinity;
  const highest = field.highest ?? Infinity;
  if (lowest > -1e6 && highest < 1e6 && highest - lowest <= 400) return { lowest, highest, log: false };
  if (lowest < 0) return undefined;
  // Where the number is set most, the file's own in the middle; further where it has been set beyond.
  const about = middle > 0 ? middle : 1;
  const below = value > 0 && value < about / USEFUL ? value / 2 : about / USEFUL;
  const above = value > about * USEFUL ? value * 2 : about * USEFUL;
  return {
    lowest: Math.max(Number(below.toPrecision(2)), lowest),
    highest: Math.min(Number(above.toPrecision(2)), highest),
    log: true,
  };
}

/** Factors around the file's value that a slider reaches first. */
const USEFUL = 20;

/** Place of a value on a slider of STEPS. */
export function sliderPlace({ lowest, highest, log }: SliderRange, value: number): number {
  if (!log) return Math.round((STEPS * (value - lowest)) / (highest - lowest));
  if (!(value > 0)) return 0;
  const share = Math.log(value / lowest) / Math.log(highest / lowest);
  return Math.min(STEPS, Math.max(1, Math.round(1 + (STEPS - 1) * share)));
}

/** The value at a place, with as many digits as places can tell apart. */
export function sliderValue({ lowest, highest, log }: SliderRange, place: number): number {
  if (!log) {
    const value = lowest + ((highest - lowest) * place) / STEPS;
    return place <= 0
      ? lowest
      : place >= STEPS
        ? highest
        : Number(value.toFixed(Math.max(0, 4 - Math.floor(Math.log10(highest - lowest)))));
  }
  if (place <= 0) return 0;
  return Number((lowest * (highest / lowest) ** ((place - 1) / (STEPS - 1))).toPrecision(4));
}

export const SLIDER_STEPS = STEPS;

/** A colour as its largest channel times a colour of brightness 1. */
export function strengthOf(rgb: readonly number[]): number {
  return Math.max(0, ...rgb);
}

function encoded(linear: number): number {
  const v = Math.min(1, Math.max(0, linear));
  return Math.round(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055));
}

/** As an input of type color has it, sRGB. */
export function hexOf(rgb: readonly number[]): string {
  const strength = strengthOf(rgb);
  return `#${[0, 1, 2]
    .map((c) =>
      encoded(strength > 0 ? rgb[c]! / strength : 1)
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
}

/** Linear Rec. 709 of such a colour, its largest channel 1; black becomes white. */
export function colourOf(hex: string): [number, number, number] {
  const linear = [1, 3, 5].map((at) => {
    const v = parseInt(hex.slice(at, at + 2), 16) / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  });
  const largest = Math.max(...linear);
  return linear.map((v) => (largest > 0 ? v / largest : 1)) as [number, number, number];
}

/** One number where all three are the same, as the scene's file has it. */
export function shortColour(rgb: readonly number[]): Value {
  const short = rgb.map((v) => Number(v.toPrecision(5)));
  return short[0] === short[1] && short[1] === short[2] ? short[0]! : short;
}

/** Three channels of a colour that may be one grey number. */
export function channels(value: Value | undefined): [number, number, number] {
  if (typeof value === "number") return [value, value, value];
  const list = Array.isArray(value) ? (value as readonly Value[]) : [];
  return list.length === 1
    ? [Number(list[0]), Number(list[0]), Number(list[0])]
    : [Number(list[0] ?? 0), Number(list[1] ?? 0), Number(list[2] ?? 0)];
}
