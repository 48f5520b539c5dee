import "../base.css";
import "./view.css";
import { render } from "preact";
import { App } from "./app";

document.documentElement.dataset["theme"] = "dark";
render(<App />, document.getElementById("app")!);
