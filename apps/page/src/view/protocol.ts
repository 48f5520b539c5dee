// The messages between the page and `brume view`.
import type { Value } from "./assignments";
import type { Bounds } from "./camera";
import type { Vec3 } from "./vector";

export interface Field {
  key: string;
  type: "number" | "integer" | "switch" | "text" | "choice" | "vector" | "color" | "numbers";
  value: Value;
  unit?: string;
  help?: string;
  lowest?: number | null;
  highest?: number | null;
  choices?: string[];
  /** The page may not change it, as names of files. */
  fixed?: boolean;
}

/** A table of the scene. */
export interface Group {
  /** As in keys: camera, volumes.0. */
  path: string;
  title: string;
  fields: Field[];
  /** Volumes: along x, y and z. */
  optical_depth?: number[];
  grids?: string[];
}

export interface LayerEntry {
  name: string;
  title?: string;
  channels: number;
  /** Under which it is listed. */
  group?: string;
  /** Of its values. */
  unit?: string;
}

export interface SceneMessage {
  type: "scene";
  id: number;
  name: string;
  /** What is looked at: frames that are there, of which nothing is rendered, instead of a scene. */
  of?: "frames";
  /** Frames of a sequence. */
  frames?: number[] | null;
  command?: string;
  /** The volumes' box in world space. */
  bounds?: Bounds | null;
  layers: LayerEntry[];
  /** Those that can be mixed, where the scene has any. */
  light_groups?: string[];
  notes?: string[];
  /** What the scene asks for that the predicted picture lacks. */
  left_out?: string[];
  groups: Group[];
  /** The file changed on disk. */
  reloaded?: boolean;
}

export interface ProgressMessage {
  type: "progress";
  id: number;
  /** What is being done; "done"; "elsewhere": another page has its turn, and this one gets nothing. */
  stage: string;
  /** Samples per pixel that have been taken, and that there will be at the end of the round. */
  samples?: number;
  goal?: number;
  /** Of the stage that is done, 0 to 1. */
  share?: number | null;
  error?: number | null;
  seconds?: number;
}

export interface ProblemMessage {
  type: "problem";
  id: number;
  text: string;
  /** Over when the scene has been read again, not by another look. */
  lasting?: boolean;
  /** Where another grid would mend it: the assignment, and what there is. */
  grid_key?: string;
  grids?: GridChoice[];
}

export interface GridChoice {
  name: string;
  type: string;
  usable: boolean;
}

export interface PointMessage {
  type: "point";
  id: number;
  position: Vec3 | null;
}

export type Message = SceneMessage | ProgressMessage | ProblemMessage | PointMessage;

export interface LookMessage {
  type: "look";
  id: number;
  set: string[];
  size: [number, number];
  moving: boolean;
  layers: string[];
  frame: number | null;
  /** What light groups are multiplied by, by colour; others are as rendered. */
  mix?: Record<string, Vec3>;
}

export interface ProbeMessage {
  type: "probe";
  id: number;
  x: number;
  y: number;
}

export interface PictureHeader {
  id: number;
  layer: string;
  width: number;
  height: number;
  channels: number;
  stage: "predicted" | "clean";
  /** Of the size that was asked for, and no better prediction follows. */
  full: boolean;
  samples: number;
  error: number | null;
  seconds: number;
  exposure: number;
  frame: number | null;
  /** false: a mix is asked for, but this layer is not known by light group, and shown as rendered. */
  mixed?: boolean;
}

/** One picture of one layer. */
export interface LayerPicture extends PictureHeader {
  /** Half floats, planes R, G, B or one plane, rows from the top. */
  half: Uint16Array;
}

export function decodePicture(message: ArrayBuffer): LayerPicture {
  if (message.byteLength < 4) throw new Error(`a picture of ${message.byteLength} bytes`);
  const length = new DataView(message).getUint32(0, true);
  if (length % 4 !== 0 || 4 + length > message.byteLength)
    throw new Error(`a picture of ${message.byteLength} bytes with a header of ${length}`);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length))) as PictureHeader;
  const { width, height, channels } = header;
  const halves = width * height * channels;
  if (!(halves > 0) || message.byteLength - 4 - length !== 2 * halves)
    throw new Error(
      `a picture of ${width} x ${height} x ${channels} cannot have ${message.byteLength - 4 - length} bytes`,
    );
  return { ...header, half: new Uint16Array(message, 4 + length, halves) };
}
