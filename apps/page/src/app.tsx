import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import { About } from "./about";
import { AblationView } from "./ablation";
import { Answer } from "./answer";
import { PageProvider, type Page } from "./context";
import { Choice, Select } from "./controls";
import { Help } from "./help";
import { BINDINGS, handleKey, tabsOf, type Actions } from "./keys";
import { Library } from "./library";
import { Look } from "./look";
import { Methods } from "./methods";
import { Numbers } from "./numbers";
import { palette } from "./palette";
import { Plots } from "./plots";
import type { Index, PictureEntry } from "./results";
import { SensitivityView } from "./sensitivity";
import { defaultView, fitting, fromHash, nameIn, toHash, type Tab, type View } from "./state";
import { fitScale, movedBy, zoomedAt, type Size, type Viewport } from "./viewport";

const TAB_NAMES: Record<Tab, string> = {
  look: "Look",
  numbers: "Numbers",
  plots: "Plots",
  ablation: "Ablation",
  sensitivity: "Sensitivity",
  about: "About",
};

const POINTER_NOTE =
  "With a pointer: the wheel or two fingers zoom, a drag moves the picture, or the divider while the whole picture is seen; a double click zooms in and out.";

type Theme = "auto" | "light" | "dark";

/** Whether a media query holds now. */
function useMedia(query: string): boolean {
  const media = useMemo(() => matchMedia(query), []);
  const [matches, setMatches] = useState(media.matches);
  useEffect(() => {
    const change = () => setMatches(media.matches);
    media.addEventListener("change", change);
    return () => media.removeEventListener("change", change);
  }, []);
  return matches;
}

/** Light or dark: as the system has it until the reader chooses; paper is light. */
function useTheme(): [boolean, () => void] {
  const systemDark = useMedia("(prefers-color-scheme: dark)");
  const printing = useMedia("print");
  const [theme, setTheme] = useState<Theme>("auto");
  const isDark = (chosen: Theme) => (chosen === "auto" ? systemDark : chosen === "dark");
  const dark = !printing && isDark(theme);
  useLayoutEffect(() => {
    document.documentElement.dataset["theme"] = dark ? "dark" : "light";
  }, [dark]);
  return [dark, () => setTheme((chosen) => (isDark(chosen) ? "light" : "dark"))];
}

export function App({ index, entries }: { index: Index; entries: PictureEntry[] }) {
  // Counts the pictures that have become available: each is a reason to draw again.
  const [, setArrived] = useState(0);
  const [message, setMessage] = useState("");
  const library = useMemo(() => new Library(entries, () => setArrived((n) => n + 1), setMessage), []);
  const normal = useMemo(() => defaultView(index, library), []);
  const [view, setView] = useState<View>(() => fromHash(location.hash, normal, index));
  // The newest view, before it is drawn: two keys between two drawings are two steps.
  const newest = useRef(view);
  const show = useCallback((next: View) => setView((newest.current = next)), []);
  const [dark, switchTheme] = useTheme();
  const help = useRef<HTMLDialogElement>(null);
  const pane = useRef<{ pane: Size; picture: Size } | undefined>(undefined);
  const set = useCallback<Page["set"]>((change) => {
    const now = newest.current;
    show(fitting(index, { ...now, ...(typeof change === "function" ? change(now) : change) }));
  }, []);
  const styles = useMemo(() => palette(index.results, dark), [dark]);
  const page: Page = { index, library, view, set, dark, name: (id) => nameIn(index, view, id) };
  const tabs = tabsOf(page);
  const tabOf = (view: View): Tab => (tabs.includes(view.tab) ? view.tab : "look");
  const tab = tabOf(view);

  useEffect(
    () => document.getElementById(`tab-${tab}`)?.scrollIntoView({ block: "nearest", inline: "nearest" }),
    [tab],
  );
  // Dragging changes the view with every frame; browsers allow a page only so many changes of its address.
  useEffect(() => {
    const later = setTimeout(() => {
      const hash = toHash(view, normal);
      if (hash !== location.hash.replace(/^#/, ""))
        history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
    }, 150);
    return () => clearTimeout(later);
  }, [view]);
  useEffect(() => {
    const follow = () => show(fromHash(location.hash, normal, index));
    addEventListener("hashchange", follow);
    return () => removeEventListener("hashchange", follow);
  }, []);
  useEffect(() => {
    if (!message) return;
    const later = setTimeout(() => setMessage(""), 6000);
    return () => clearTimeout(later);
  }, [message]);

  /** Takes a step of the picture. @return whether it changed what is seen */
  const move = (step: (p: { pane: Size; picture: Size }) => Viewport) => {
    if (!pane.current || tabOf(newest.current) !== "look") return false;
    const before = newest.current;
    set(step(pane.current));
    const near = (a: number, b: number) => Math.abs(a - b) < 1e-9;
    const now = newest.current;
    return !(near(before.zoom, now.zoom) && near(before.x, now.x) && near(before.y, now.y));
  };
  const zoom = (factor: number) =>
    move((p) => zoomedAt(newest.current, factor, p.pane.width / 2, p.pane.height / 2, p.picture, p.pane));
  const actions: Actions = {
    tabs,
    help: () => !help.current!.open && help.current!.showModal(),
    theme: switchTheme,
    zoom,
    notice: setMessage,
    pan: (dx, dy) =>
      move((p) => movedBy(newest.current, (dx * p.pane.width) / 8, (dy * p.pane.height) / 8, p.picture, p.pane)),
    actualSize: () =>
      move((p) =>
        zoomedAt(
          newest.current,
          1 / devicePixelRatio / fitScale(p.picture, p.pane) / newest.current.zoom,
          p.pane.width / 2,
          p.pane.height / 2,
          p.picture,
          p.pane,
        ),
      ),
    link: () => {
      const hash = toHash(newest.current, normal);
      const address = location.href.replace(/#.*$/, "") + (hash ? `#${hash}` : "");
      const told = () => setMessage("The address bar holds a link to this view");
      if (navigator.clipboard)
        navigator.clipboard.writeText(address).then(() => setMessage("Link to this view copied"), told);
      else told();
    },
  };
  const latest = useRef({ page, actions });
  latest.current = { page, actions };
  // Before the first drawing: a key that is pressed at its sight counts.
  useLayoutEffect(() => {
    const key = (event: KeyboardEvent) => {
      const { page, actions } = latest.current;
      const view = newest.current;
      handleKey(event, { ...page, view: { ...view, tab: tabOf(view) } }, actions);
    };
    addEventListener("keydown", key);
    return () => removeEventListener("keydown", key);
  }, []);

  const { scenes, metrics, brume, commit, command } = index.results;
  const spp = index.spp(view.scene);
  const regions = index.regions();
  const sceneChoice = {
    values: scenes.map((s) => ({ value: s.name, text: s.name })),
    value: view.scene,
    onChange: (scene: string) => set({ scene }),
  };
  const onTabKey = (event: KeyboardEvent) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!by) return;
    const next = tabs[(tabs.indexOf(tabOf(newest.current)) + by + tabs.length) % tabs.length]!;
    set({ tab: next });
    document.getElementById(`tab-${next}`)?.focus();
  };

  return (
    <PageProvider value={page}>
      <header class="top">
        <h1>
          <svg viewBox="0 0 32 32" aria-hidden="true">
            <path d="M4 11c5-5 9 3 14 0s6-4 10-2M3 18c6-5 10 3 15 0s7-4 11-2M7 25c5-4 8 2 12 0s5-3 8-2" />
          </svg>
          brume
        </h1>
        <div class="choices">
          {scenes.length > 4 && <Select label="Scene" {...sceneChoice} />}
          {scenes.length > 1 && scenes.length <= 4 && <Choice label="Scene" {...sceneChoice} />}
          <Choice
            label="Samples per pixel"
            before="spp"
            values={spp.map((n) => ({ value: n, text: String(n), title: `${n} samples per pixel` }))}
            value={view.spp}
            onChange={(n) => set({ spp: n })}
          />
          {metrics.length > 0 && (
            <Select
              label="Metric"
              value={view.metric}
              values={metrics.map((m) => ({ value: m.id, text: m.name }))}
              onChange={(metric) => set({ metric, sort: metric, descending: false })}
            />
          )}
          {regions.length > 1 && (
            <Choice
              label="Pixels that count"
              values={regions.map((r) => ({
                value: r,
                text: r,
                title: r === "medium" ? "Pixels that show the medium" : "The whole frame",
              }))}
              value={view.region}
              onChange={(region) => set({ region })}
            />
          )}
        </div>
        <div class="tools">
          <button type="button" title="Copy a link to this view (y)" onClick={actions.link}>
            Link
          </button>
          <button
            type="button"
            class="icon"
            title="Light or dark (u)"
            aria-label={dark ? "Light colours" : "Dark colours"}
            onClick={switchTheme}
          >
            {dark ? "☀" : "☾"}
          </button>
          <button type="button" class="icon" title="Keys (?)" aria-label="Keys" onClick={actions.help}>
            ?
          </button>
        </div>
      </header>
      <Answer />
      <nav aria-label="Views">
        <div role="tablist" onKeyDown={onTabKey}>
          {tabs.map((t) => (
            <button
              key={t}
              id={`tab-${t}`}
              type="button"
              role="tab"
              aria-selected={t === tab}
              aria-controls="view"
              tabIndex={t === tab ? 0 : -1}
              onClick={() => set({ tab: t })}
            >
              {TAB_NAMES[t]}
            </button>
          ))}
        </div>
      </nav>
      <div class="body">
        <Methods styles={styles} />
        <main>
          <div id="view" role="tabpanel" aria-labelledby={`tab-${tab}`}>
            {tab === "look" && (
              <Look
                zoom={zoom}
                actualSize={actions.actualSize}
                onPane={(p, picture) => (pane.current = { pane: p, picture })}
              />
            )}
            {tab === "numbers" && <Numbers />}
            {tab === "plots" && <Plots styles={styles} />}
            {tab === "ablation" && <AblationView />}
            {tab === "sensitivity" && <SensitivityView styles={styles} />}
            {tab === "about" && <About />}
          </div>
        </main>
      </div>
      <p class="origin">
        brume {brume} {commit}: <code>{command}</code>
      </p>
      <div class="message" role="status">
        {message}
      </div>
      <Help dialog={help} groups={BINDINGS} note={POINTER_NOTE} />
    </PageProvider>
  );
}
