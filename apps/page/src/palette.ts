// A colour and a line style for each method, told apart on light and on dark ground.
import { rgbFromOklab } from "./color";
import { isUnfiltered, settingOf, type Results } from "./results";

export interface Style {
  colour: string;
  dash: number[];
}

const DASHES: Record<string, number[]> = {
  "": [],
  searched: [],
  default: [6, 4],
  paper: [2, 3],
  transfer: [10, 3, 2, 3],
};

/** Settings of one filter share their colour. */
export function palette(results: Results, dark: boolean): Map<string, Style> {
  const labels = [...new Set(results.methods.filter((m) => !isUnfiltered(m)).map((m) => m.label))];
  const styles = new Map<string, Style>();
  for (const method of results.methods) {
    const place = labels.indexOf(method.label);
    // The golden angle keeps neighbours apart; lightness alternates for what is left.
    const hue = ((250 + 137.508 * place) * Math.PI) / 180;
    const lightness = (dark ? 0.74 : 0.56) + (place % 3 === 1 ? 0.06 : place % 3 === 2 ? -0.06 : 0);
    const [r, g, b] = isUnfiltered(method)
      ? rgbFromOklab(dark ? 0.72 : 0.5, 0, 0)
      : rgbFromOklab(lightness, 0.135 * Math.cos(hue), 0.135 * Math.sin(hue));
    styles.set(method.id, { colour: `rgb(${r}, ${g}, ${b})`, dash: DASHES[settingOf(method)] ?? [4, 2] });
  }
  return styles;
}
