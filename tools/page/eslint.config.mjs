// The rules of the page's JavaScript: nothing undefined, nothing unused, lines of at most 120 characters.

const GLOBALS = `Blob CSS CustomEvent DataView DecompressionStream EventTarget Image MeshCat MutationObserver
  ResizeObserver Response TextDecoder URL URLSearchParams WebSocket XMLSerializer atob cancelAnimationFrame
  clearTimeout document fetch getComputedStyle globalThis history localStorage location matchMedia navigator
  performance queueMicrotask requestAnimationFrame setTimeout structuredClone window`.split(/\s+/);

export default [
  {
    files: ["**/*.js"],
    languageOptions: { globals: Object.fromEntries(GLOBALS.map((name) => [name, "readonly"])) },
    linterOptions: { reportUnusedDisableDirectives: false },
    rules: {
      "no-undef": "error",
      "no-unused-vars": ["error", { argsIgnorePattern: "^_", ignoreRestSiblings: true, caughtErrors: "none" }],
      "no-const-assign": "error",
      "no-dupe-keys": "error",
      "no-redeclare": "error",
      "no-shadow-restricted-names": "error",
      "no-unreachable": "error",
      "no-var": "error",
      "prefer-const": ["error", { destructuring: "all" }],
      "eqeqeq": ["error", "always", { null: "ignore" }],
      "max-len": ["error", 120],
    },
  },
];
