import { readFileSync } from "node:fs";
import { defineConfig, type Plugin } from "vite";

/** The licence of a package travels with its code, also into every report. */
function withLicence(name: string, title: string): Plugin {
  const licence = readFileSync(new URL(`node_modules/${name}/LICENSE`, import.meta.url), "utf8").trim();
  return {
    name: "with-licence",
    generateBundle(_, bundle) {
      for (const file of Object.values(bundle)) {
        if (file.type === "chunk") file.code = `/*! Contains ${title}.\n${licence}\n*/\n${file.code}`;
      }
    },
  };
}

// Browsers that know light-dark().
const TARGETS = { target: "es2022", cssTarget: ["chrome123", "firefox120", "safari17.5"] };

// The report's viewer is one script and one style sheet, which Python writes into the page: nothing is fetched when a
// report is opened. `--mode app` builds the page of `pomona app`, which its server serves.
export default defineConfig(({ mode }) =>
  mode === "app"
    ? {
        plugins: [withLicence("preact", "Preact")],
        oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
        build: {
          ...TARGETS,
          outDir: "../src/pomona/browser/app/static",
          emptyOutDir: true,
          lib: { entry: "src/app/main.tsx", formats: ["es"], fileName: () => "app.js", cssFileName: "app" },
        },
        define: { "process.env.NODE_ENV": '"production"' },
      }
    : {
        plugins: [withLicence("three", "three.js")],
        build: {
          ...TARGETS,
          outDir: "../src/pomona/stages/report/static",
          emptyOutDir: true,
          lib: { entry: "src/main.ts", formats: ["iife"], name: "PomonaViewer", fileName: () => "viewer.js", cssFileName: "viewer" },
        },
      },
);
