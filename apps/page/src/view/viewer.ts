// What the page knows: the scene and what is assigned in it, the pictures that came, and what is asked for next.
import { asSet, assigned, dropped, NONE, type Assignments, type Value } from "./assignments";
import { roundedCamera, type Bounds, type Camera } from "./camera";
import { Connection } from "./connection";
import { TONE_NAMES, TONES } from "../color";
import { Drawn } from "./display";
import { DisplayCube } from "./display_cube";
import { FrameCache } from "./frame_cache";
import { History } from "./history";
import { isMixed, mixOf, withoutMix } from "./mix";
import {
  decodePicture,
  type LayerPicture,
  type LookMessage,
  type Message,
  type ProblemMessage,
  type ProgressMessage,
  type SceneMessage,
} from "./protocol";
import { SceneValues } from "./scene_values";
import { unitText } from "./field_info";
import { keep, pictureSize, restore, type Settings, type ViewTone } from "./settings";
import { Topic } from "./topic";
import type { Vec3 } from "./vector";

export type Tool = "camera" | "sun" | "lamp";

/** What a wheel or a key moves comes to rest after this pause [ms]. */
const REST = 200;
/** Frames follow each other no faster [ms]. */
const FRAME_TIME = 1000 / 24;
/** Longest wait for the picture of one mix of lights before the next is sent [ms]. */
const MIX_PATIENCE = 400;

export class Viewer {
  /** Scene, state and settings. */
  readonly changed = new Topic();
  /** Pictures and progress: many times a second while something moves. */
  readonly arrived = new Topic();

  readonly values = new SceneValues();
  readonly history: History<Assignments>;
  settings: Settings;
  tool: Tool = "camera";
  /** The assignment that the sun tool turns. */
  sun = "";
  frame: number | null = null;
  playing = false;
  progress: ProgressMessage | undefined;
  /** When the progress was told, and when its stage or round began: clock of performance.now() [ms]. */
  told = { at: 0, began: 0, share: 0 };
  problem: ProblemMessage | undefined;
  /** A short message about what has just been done. */
  said = "";
  pictures = new Map<string, Drawn>();
  /** Through which the program's options say that pictures are shown. */
  screen: DisplayCube | undefined;

  private readonly connection: Connection;
  private readonly cache = new FrameCache();
  private area = { width: 0, height: 0 };
  private ids = firstId();
  /** Assignments of the looks that were sent, for the values of the scene messages that answer them. */
  private readonly sent = new Map<number, Assignments>();
  private readonly probes = new Map<number, (point: Vec3 | null) => void>();
  /** What the cached frames depend on, and the first look that asked for it. */
  private asked = { what: "", since: 0 };
  private latest = "";
  /** The mix of lights that was sent last, in which look, and until when its picture is waited for. */
  private mixing: { mix: string | undefined; id: number; until: number } = { mix: undefined, id: 0, until: 0 };
  private moves = false;
  private scheduled = 0;
  private rest: ReturnType<typeof setTimeout> | undefined;
  /** When the sequence went on to the present frame. */
  private advanced = 0;
  private nextFrame: ReturnType<typeof setTimeout> | undefined;
  private silence: ReturnType<typeof setTimeout> | undefined;

  constructor(address: string) {
    const { settings, assignments } = restore();
    this.settings = settings;
    this.history = new History(assignments);
    this.connection = new Connection(address, new URL(".", location.href).href, {
      opened: () => {
        this.latest = "";
        this.look();
      },
      text: (message) => this.receive(JSON.parse(message) as Message),
      binary: (message) => this.show(decodePicture(message)),
      changed: () => this.changed.emit(),
    });
    void this.readScreen();
  }

  private async readScreen(): Promise<void> {
    // A program that cannot be reached is told by the connection.
    const answer = await fetch(new URL("display.cube", location.href), { cache: "no-store" }).catch(() => undefined);
    if (answer?.status !== 200) return;
    try {
      const bytes = await answer.arrayBuffer();
      if (bytes.byteLength === 0) return; // the page's own curves do
      this.screen = DisplayCube.decode(bytes);
      this.changed.emit();
    } catch (problem) {
      this.say(`pictures are shown in sRGB: ${problem instanceof Error ? problem.message : String(problem)}`);
    }
  }

  /** How pictures are shown. */
  get tone(): ViewTone {
    return this.settings.tone === "display" && !this.screen ? "srgb" : this.settings.tone;
  }
  get tones(): { value: ViewTone; text: string }[] {
    const curves = TONES.map((value) => ({ value, text: TONE_NAMES[value] }));
    return this.screen ? [{ value: "display", text: this.screen.name }, ...curves] : curves;
  }

  get link() {
    return this.connection.link;
  }
  get scene(): SceneMessage | undefined {
    return this.values.message;
  }
  get assignments(): Assignments {
    return this.history.now;
  }
  get moving(): boolean {
    return this.moves;
  }
  /** Whether frames that are there are looked at, which have neither camera nor lights to change. */
  get ofFrames(): boolean {
    return this.scene?.of === "frames";
  }
  get camera(): Camera | undefined {
    if (this.ofFrames) return undefined;
    return this.values.camera(this.assignments);
  }
  get bounds(): Bounds | undefined {
    return this.scene?.bounds ?? undefined;
  }
  get layers(): string[] {
    const { layer, other } = this.settings;
    return other && other !== layer ? [layer, other] : [layer];
  }
  /** Layers that are asked for: the picture stands in for those that only path tracing gives. */
  private get wanted(): string[] {
    return [...new Set([...this.layers, "picture"])];
  }
  /** What is shown of a layer. One that is not there yet is not shown, but that while something moves the picture
   *  stands in for it, under its own name. */
  shown(layer: string): Drawn | undefined {
    const own = this.pictures.get(layer);
    const standIn = this.pictures.get("picture");
    const newer = standIn?.picture.stage === "predicted" && (!own || own.picture.id < standIn.picture.id);
    return newer && layer !== "picture" ? (this.moves ? standIn : undefined) : own;
  }
  /** Layers that are chosen and not there, for what is seen now. */
  get missing(): string[] {
    return this.layers.filter((name) => this.shown(name)?.picture.layer !== name);
  }
  /** The cached pictures of a frame that can be shown. */
  private cached(frame: number): LayerPicture[] | undefined {
    return this.cache.get(frame, this.layers) ?? this.cache.get(frame, ["picture"]);
  }
  /** Columns and rows of the picture that is asked for. */
  get size(): [number, number] {
    return pictureSize(this.area, window.devicePixelRatio || 1, this.settings.resolution);
  }
  get aspect(): number {
    const [width, height] = this.size;
    return width / height;
  }
  get shownFrame(): number | null {
    return this.frame ?? this.shown(this.settings.layer)?.picture.frame ?? this.scene?.frames?.[0] ?? null;
  }

  layerUnit(name: string): string {
    const unit = this.scene?.layers.find((layer) => layer.name === name)?.unit;
    return unitText(unit);
  }
  layerTitle(name: string): string {
    return this.scene?.layers.find((layer) => layer.name === name)?.title ?? name;
  }

  value(key: string): Value | undefined {
    return this.values.value(this.assignments, key);
  }

  // Changes of the scene

  /** @param step   of a drag or the like: until settle(), changes of one name are one step
   *  @param moves  pictures may be coarse until then */
  edit(change: (all: Assignments) => Assignments, step?: string, moves = step !== undefined): void {
    const before = this.assignments;
    this.history.change(change(before), step);
    if (moves) this.moves = true;
    if (this.assignments !== before || step !== undefined) this.stateChanged();
  }
  assign(key: string, value: Value, step?: string): void {
    this.edit((all) => assigned(all, key, value), step);
  }
  reset(key: string): void {
    this.edit((all) => dropped(all, key));
  }
  resetAll(): void {
    if (this.assignments.size) this.edit(() => NONE);
  }
  undo(): void {
    this.history.undo();
    this.stateChanged();
  }
  redo(): void {
    this.history.redo();
    this.stateChanged();
  }

  /** Assigns what of the camera has changed. */
  moveCamera(change: (camera: Camera) => Camera, step?: string): void {
    const before = this.camera;
    if (!before) return;
    const after = roundedCamera(change(before));
    this.edit((all) => {
      let next = all;
      for (const key of ["position", "look_at", "fov", "width", "focus_distance"] as const)
        if (JSON.stringify(after[key]) !== JSON.stringify(before[key]))
          next = assigned(next, `camera.${key}`, after[key]);
      // A camera that keys move would stay where they have it.
      const keys = this.value("camera.keys");
      if (next !== all && keys !== undefined && String(keys).replace("[]", ""))
        next = assigned(next, "camera.keys", []);
      return next;
    }, step);
  }

  /** A change by a wheel or key, which has no end of its own. */
  nudge(change: () => void): void {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.settle(), REST);
    change();
  }

  /** The drag has ended. */
  settle(): void {
    clearTimeout(this.rest);
    this.history.endStep();
    if (!this.moves) return;
    this.moves = false;
    this.schedule();
  }

  private stateChanged(): void {
    keep(this.settings, this.assignments);
    this.changed.emit();
    this.schedule();
  }

  // Changes of the view

  set(change: Partial<Settings>): void {
    const before = [this.layers.join(), this.size.join()].join();
    this.settings = { ...this.settings, ...change };
    keep(this.settings, this.assignments);
    this.changed.emit();
    if ([this.layers.join(), this.size.join()].join() !== before) this.schedule();
  }
  use(tool: Tool): void {
    this.tool = this.ofFrames ? "camera" : tool;
    this.changed.emit();
  }
  resize(area: { width: number; height: number }): void {
    if (area.width === this.area.width && area.height === this.area.height) return;
    const first = !this.area.width;
    this.area = area;
    if (first) this.schedule();
    // While a window is drawn larger, pictures may be coarse.
    else
      this.nudge(() => {
        this.moves = true;
        this.schedule();
      });
  }
  say(what: string): void {
    this.said = what;
    clearTimeout(this.silence);
    this.silence = setTimeout(() => this.say(""), 6000);
    if (!what) clearTimeout(this.silence);
    this.changed.emit();
  }
  dismiss(): void {
    this.problem = undefined;
    this.changed.emit();
  }
  retry(): void {
    this.connection.retry();
  }

  // The sequence

  goTo(frame: number, moving = false): void {
    this.frame = frame;
    if (moving) this.moves = true;
    const cached = this.cached(frame);
    if (cached) this.draw(cached);
    this.changed.emit();
    this.schedule();
  }
  stepFrame(by: number): void {
    const frames = this.scene?.frames;
    if (!frames?.length) return;
    const at = frames.indexOf(this.shownFrame ?? frames[0]!);
    this.goTo(frames[(at + by + frames.length) % frames.length]!);
  }
  togglePlay(): void {
    if (this.playing) this.pause();
    else if ((this.scene?.frames?.length ?? 0) > 1) {
      this.playing = true;
      this.advance();
    }
  }
  private pause(): void {
    this.playing = false;
    clearTimeout(this.nextFrame);
    this.moves = false;
    this.changed.emit();
    this.schedule();
  }
  /** Shows the next frame: from the cache, or asked for; it calls for its next one when it has come. */
  private advance(): void {
    const frames = this.scene?.frames;
    if (!this.playing || !frames?.length) return;
    this.advanced = performance.now();
    this.frame = frames[(frames.indexOf(this.shownFrame ?? frames[0]!) + 1) % frames.length]!;
    const cached = this.cached(this.frame);
    if (cached) {
      this.draw(cached);
      this.advanceLater();
    } else {
      this.moves = true;
      this.schedule();
    }
    this.changed.emit();
  }
  private advanceLater(): void {
    clearTimeout(this.nextFrame);
    this.nextFrame = setTimeout(() => this.advance(), Math.max(0, this.advanced + FRAME_TIME - performance.now()));
  }

  // Messages

  /** Sends the state before the next picture is drawn: drags send at most one message for each. */
  private schedule(): void {
    if (this.scheduled) return;
    this.scheduled = requestAnimationFrame(() => {
      this.scheduled = 0;
      // While the socket is busy, or a mix of lights is not shown yet, newer states replace older ones.
      if (this.connection.busy || performance.now() < this.mixing.until) this.schedule();
      else this.look();
    });
  }
  /** The state of this moment. */
  get state(): Omit<LookMessage, "type" | "id"> {
    const mix = mixOf(this.assignments, this.scene && (this.scene.light_groups ?? []));
    return {
      set: asSet(withoutMix(this.assignments)),
      size: this.size,
      moving: this.moves,
      layers: this.wanted,
      frame: this.frame,
      ...(mix ? { mix } : {}),
    };
  }
  /** Takes the program's turn back from another page. */
  resume(): void {
    if (this.progress?.stage !== "elsewhere") return;
    this.latest = "";
    this.look();
  }
  private look(): void {
    if (!this.area.width || !this.area.height) return;
    const look = this.state;
    const { set, size, layers, mix } = look;
    // One that says nothing new would begin the picture again.
    if (JSON.stringify(look) === this.latest) return;
    const message: LookMessage = { type: "look", id: ++this.ids, ...look };
    const what = JSON.stringify([set, size, layers, mix]);
    if (what !== this.asked.what) {
      this.asked = { what, since: message.id };
      this.cache.clear();
    }
    if (!this.connection.send(message)) return;
    if (JSON.stringify(mix) !== this.mixing.mix)
      this.mixing = { mix: JSON.stringify(mix), id: message.id, until: performance.now() + MIX_PATIENCE };
    this.latest = JSON.stringify(look);
    this.sent.set(message.id, this.assignments);
    for (const [id] of this.sent) {
      if (this.sent.size <= 1000) break;
      this.sent.delete(id);
    }
  }

  /** Asks for the point that is seen at a place of the picture, 0 to 1 from its left and top. */
  probe(x: number, y: number): Promise<Vec3 | null> {
    return new Promise((resolve) => {
      const id = ++this.ids;
      if (this.connection.send({ type: "probe", id, x, y })) this.probes.set(id, resolve);
    });
  }

  private receive(message: Message): void {
    switch (message.type) {
      case "scene":
        this.values.take(message, this.sent.get(message.id));
        this.fitToScene(message);
        if (message.reloaded) this.problem = undefined;
        this.settled(message.id);
        if (message.reloaded) this.cache.clear();
        if (message.reloaded) this.say(`The ${this.ofFrames ? "frame" : "scene"}'s file has changed: it was read again`);
        // A group that the scene no longer has is not asked for again.
        if (isMixed(this.assignments)) this.schedule();
        this.changed.emit();
        break;
      case "progress": {
        const now = performance.now();
        const goes = this.progress?.stage === message.stage && this.progress.goal === message.goal;
        const { began, share } = goes ? this.told : { began: now, share: message.share ?? 0 };
        this.told = { at: now, began, share };
        this.progress = message;
        this.arrived.emit();
        break;
      }
      case "problem":
        this.problem = message;
        this.answeredMix(message.id);
        if (this.playing) this.pause();
        this.changed.emit();
        break;
      case "point":
        this.probes.get(message.id)?.(message.position);
        this.probes.delete(message.id);
        break;
    }
  }

  /** A problem is over when something newer has come without one. */
  private settled(id: number): void {
    if (!this.problem || this.problem.lasting || id <= this.problem.id) return;
    this.problem = undefined;
    this.changed.emit();
  }

  private fitToScene(scene: SceneMessage): void {
    // Layers of guides are listed once there are guides.
    const there = (name: string) => name.startsWith("guide.") || scene.layers.some((layer) => layer.name === name);
    const { layer, other } = this.settings;
    if (!there(layer) || (other && !there(other)))
      this.set({
        layer: there(layer) ? layer : (scene.layers[0]?.name ?? "picture"),
        other: there(other) ? other : "",
      });
    if (this.frame !== null && !scene.frames?.includes(this.frame)) this.frame = null;
  }

  private answeredMix(id: number): void {
    if (id >= this.mixing.id) this.mixing.until = 0;
  }

  private show(picture: LayerPicture): void {
    this.settled(picture.id);
    this.answeredMix(picture.id);
    if (picture.frame !== null && picture.frame !== undefined && picture.id >= this.asked.since)
      this.cache.put(picture.frame, picture);
    if (!this.wanted.includes(picture.layer)) return;
    const before = this.pictures.get(picture.layer)?.picture;
    // Frames out of the cache may be older than the picture of a frame that is no longer wanted.
    const wanted = this.frame === null || picture.frame === this.frame;
    if (!wanted || (before && before.frame === picture.frame && before.id > picture.id)) return;
    this.draw([picture]);
    if (this.playing && this.frame !== null && this.cached(this.frame)) this.advanceLater();
  }

  private draw(pictures: readonly LayerPicture[]): void {
    for (const picture of pictures) this.pictures.set(picture.layer, new Drawn(picture));
    this.arrived.emit();
  }
}

/** Identities rise with each message, and from one loading of the page to the next: seconds since 2025. */
function firstId(): number {
  return Math.max(0, Math.floor((Date.now() - Date.UTC(2025, 0, 1)) / 1000));
}
