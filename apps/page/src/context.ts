import { createContext } from "preact";
import { useContext } from "preact/hooks";
import type { Library } from "./library";
import type { Index } from "./results";
import type { View } from "./state";

export interface Page {
  index: Index;
  library: Library;
  view: View;
  /** A method's name, with its setting where more than one is listed. */
  name: (method: string) => string;
  /** Changes the view: by values, or by what follows from the newest view. */
  set: (change: Partial<View> | ((view: View) => Partial<View>)) => void;
  dark: boolean;
}

const PageContext = createContext<Page | undefined>(undefined);
export const PageProvider = PageContext.Provider;

export function usePage(): Page {
  const page = useContext(PageContext);
  if (!page) throw new Error("a part of the page stands outside of it");
  return page;
}
