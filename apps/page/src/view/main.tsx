import "../base.css";
import "./view.css";
import { render } from "preact";
import { App } from "./app";

// Light where the system asks for it, also when it changes its mind.
const light = matchMedia("(prefers-color-scheme: light)");
const follow = () => (document.documentElement.dataset["theme"] = light.matches ? "light" : "dark");
light.addEventListener("change", follow);
follow();
render(<App />, document.getElementById("app")!);
