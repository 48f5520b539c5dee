import { createContext } from "preact";
import { useContext } from "preact/hooks";
import { useTopic } from "./topic";
import type { Viewer } from "./viewer";

const ViewerContext = createContext<Viewer | undefined>(undefined);
export const ViewerProvider = ViewerContext.Provider;

/** The viewer; the component is drawn again when its state changes. */
export function useViewer(): Viewer {
  const viewer = useContext(ViewerContext);
  if (!viewer) throw new Error("a part of the page stands outside of it");
  useTopic(viewer.changed);
  return viewer;
}
