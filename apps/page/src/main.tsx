import "./base.css";
import "./style.css";
import { render } from "preact";
import { App } from "./app";
import { complete, Index, type PictureEntry, type Results } from "./results";

function json<T>(id: string): T {
  return JSON.parse(document.getElementById(id)!.textContent ?? "") as T;
}

render(
  <App index={new Index(complete(json<Partial<Results>>("results")))} entries={json<PictureEntry[]>("pictures")} />,
  document.getElementById("app")!,
);
