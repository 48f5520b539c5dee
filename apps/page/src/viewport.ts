// Which part of a picture is seen. The same numbers hold for panes of every size, so that all show the same region.

export interface Viewport {
  /** Centre of the pane in the picture, 0 to 1 from its left and top. */
  x: number;
  y: number;
  /** 1: the whole picture just fits. */
  zoom: number;
}

export interface Size {
  width: number;
  height: number;
}

export interface Transform {
  /** Pane pixels for each picture pixel. */
  scale: number;
  /** Where the picture's upper left corner lies in the pane. */
  left: number;
  top: number;
}

export const WHOLE: Viewport = { x: 0.5, y: 0.5, zoom: 1 };
const LARGEST = 64;
const SMALLEST = 0.125;

export function fitScale(picture: Size, pane: Size): number {
  return Math.min(pane.width / picture.width, pane.height / picture.height);
}

export function transform(view: Viewport, picture: Size, pane: Size): Transform {
  const scale = fitScale(picture, pane) * view.zoom;
  return {
    scale,
    left: pane.width / 2 - view.x * picture.width * scale,
    top: pane.height / 2 - view.y * picture.height * scale,
  };
}

/** Keeps the picture in the pane: centred along an axis on which all of it is seen, without a gap along others. */
export function contained(view: Viewport, picture: Size, pane: Size): Viewport {
  const zoom = Math.min(Math.max(view.zoom, SMALLEST), LARGEST);
  const scale = fitScale(picture, pane) * zoom;
  const along = (centre: number, length: number, room: number) => {
    const half = room / (2 * scale * length);
    return half >= 0.5 ? 0.5 : Math.min(Math.max(centre, half), 1 - half);
  };
  return {
    x: along(view.x, picture.width, pane.width),
    y: along(view.y, picture.height, pane.height),
    zoom,
  };
}

/** Whether nothing of the picture lies outside the pane. */
export function showsAll(view: Viewport): boolean {
  return view.zoom <= 1.0001;
}

/** Zooms by a factor and leaves what is at (px, py) of the pane where it is. */
export function zoomedAt(view: Viewport, factor: number, px: number, py: number, picture: Size, pane: Size): Viewport {
  const zoom = Math.min(Math.max(view.zoom * factor, SMALLEST), LARGEST);
  const before = transform(view, picture, pane);
  const after = fitScale(picture, pane) * zoom;
  const u = (px - before.left) / before.scale;
  const v = (py - before.top) / before.scale;
  return contained(
    {
      x: (u - (px - pane.width / 2) / after) / picture.width,
      y: (v - (py - pane.height / 2) / after) / picture.height,
      zoom,
    },
    picture,
    pane,
  );
}

export function movedBy(view: Viewport, dx: number, dy: number, picture: Size, pane: Size): Viewport {
  const { scale } = transform(view, picture, pane);
  return contained(
    { ...view, x: view.x - dx / (scale * picture.width), y: view.y - dy / (scale * picture.height) },
    picture,
    pane,
  );
}

/** The picture's pixel at a place in the pane; nothing outside. */
export function pixelAt(view: Viewport, px: number, py: number, picture: Size, pane: Size) {
  const { scale, left, top } = transform(view, picture, pane);
  const x = Math.floor((px - left) / scale);
  const y = Math.floor((py - top) / scale);
  return x >= 0 && y >= 0 && x < picture.width && y < picture.height ? { x, y } : undefined;
}
