// node build.mjs FOLDER: bundles the page of `brume evaluate` into FOLDER/page.js and FOLDER/page.css, and both as C++ into
// FOLDER/page_bundle.cpp for the program to embed; that of `brume view` likewise into view.js, view.css, view_bundle.cpp.
// node build.mjs FOLDER tests: bundles the tests into FOLDER instead.
import { build } from "esbuild";
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const [folder, what] = process.argv.slice(2);
if (!folder) throw new Error("usage: node build.mjs FOLDER [tests]");

const common = {
  bundle: true,
  absWorkingDir: here,
  charset: "ascii",
  jsx: "automatic",
  jsxImportSource: "preact",
  logLevel: "warning",
};

if (what === "tests") {
  const tests = readdirSync(join(here, "test")).filter((name) => name.endsWith("_test.ts"));
  await build({
    ...common,
    entryPoints: tests.map((name) => join("test", name)),
    outdir: folder,
    outExtension: { ".js": ".mjs" },
    platform: "node",
    format: "esm",
    target: "node18",
    define: { PAGE_FOLDER: JSON.stringify(here) },
  });
} else {
  // The licences of what is bundled ask that they go with it.
  const { dependencies } = JSON.parse(readFileSync(join(here, "package.json"), "utf8"));
  const notices = Object.keys(dependencies).map(
    (name) => `${name}: ${readFileSync(join(here, "node_modules", name, "LICENSE"), "utf8").trim()}`,
  );
  const banner = { js: `/*\n${notices.join("\n\n")}\n*/` };
  await build({
    ...common,
    entryPoints: { page: "src/main.tsx", view: "src/view/main.tsx" },
    banner,
    outdir: folder,
    format: "iife",
    target: ["es2022"],
    minify: true,
    legalComments: "none",
  });

  // A script or style element ends at its first end tag, wherever that stands; a comment may hide it.
  const bytes = (name, tag) => {
    const text = readFileSync(join(folder, name), "utf8");
    if (new RegExp(`</${tag}|<!--`, "i").test(text)) throw new Error(`${name} would end its element <${tag}> early`);
    return [...Buffer.from(text, "ascii")].join(",").replace(/(.{1,118}),/g, "$1,\n");
  };
  const embed = (name, header) => {
    const source = [
      "// Written by apps/page/build.mjs.",
      `#include "${header}"`,
      "namespace brume {",
      "namespace {",
      `constexpr char kScript[] = {${bytes(`${name}.js`, "script")}};`,
      `constexpr char kStyle[] = {${bytes(`${name}.css`, "style")}};`,
      "}  // namespace",
      `const std::string_view ${name}_script{kScript, sizeof kScript}, ${name}_style{kStyle, sizeof kStyle};`,
      "}  // namespace brume",
      "",
    ].join("\n");
    writeFileSync(join(folder, `${name}_bundle.cpp`), source);
  };
  embed("page", "evaluate/report/page_bundle.h");
  embed("view", "apps/view/view_bundle.h");
}
