import { readFileSync } from "node:fs";
import { defineConfig, type Plugin } from "vite";

const licence = readFileSync(new URL("node_modules/three/LICENSE", import.meta.url), "utf8").trim();

/** The licence of three.js travels with its code, also into every report. */
const withLicence: Plugin = {
  name: "with-licence",
  generateBundle(_, bundle) {
    for (const file of Object.values(bundle)) {
      if (file.type === "chunk") file.code = `/*! Contains three.js.\n${licence}\n*/\n${file.code}`;
    }
  },
};

// One script and one style sheet, which Python writes into the page: nothing is fetched when a report is opened.
export default defineConfig({
  plugins: [withLicence],
  build: {
    outDir: "../src/pomona/report/static",
    emptyOutDir: true,
    target: "es2022",
    // Browsers that know light-dark().
    cssTarget: ["chrome123", "firefox120", "safari17.5"],
    lib: { entry: "src/main.ts", formats: ["iife"], name: "PomonaViewer", fileName: () => "viewer.js", cssFileName: "viewer" },
  },
});
