// Guided starts, for who opens a page without a mechanism: Python says the steps, this takes them.

import { all, button, byId, el, heading, hint, openDialog, reveal } from "./dom.js";

/** The choice at first, and the steps of the one that was chosen. */
export function guides(store) {
  const address = (number) => `${location.pathname}?mechanism=${number}`;

  function choose(found) {
    openDialog("report", "Where to start",
      ...found.map(({ title, words }, k) => el("a.start", { href: address(k) }, el("b", title),
        el("span.dim", words))),
      hint("Each takes a minute. Your own mechanism: cartstiff view NAME, or a file; cartstiff models lists names."));
  }

  function lead({ title, steps }, others) {
    const words = el("p", { role: "status" });
    const count = el("span.dim.small");
    const [back, next] = [button("Back", () => go(at - 1)), button("Next", () => go(at + 1), { class: "primary" })];
    const card = el("div.card.guide-card", { role: "region", "aria-label": title },
      heading(title), words, el("div.row", back, next, count, el("span.grow"),
        button("End", () => end(), { class: "quiet" })));
    let at = -1;
    const end = () => {
      for (const node of all(".guided")) node.classList.remove("guided");
      card.remove();
    };

    function go(k) {
      if (k === steps.length) return end();
      at = k;
      const { words: said, state, plot, reveal: part } = steps[k];
      words.textContent = said;
      count.textContent = `${k + 1} of ${steps.length}`;
      back.disabled = k === 0;
      next.textContent = k === steps.length - 1 ? "Done" : "Next";
      if (Object.keys(plot).length) store.showPlot(plot);
      if (Object.keys(state).length) store.change(structuredClone(state));
      for (const node of all(".guided")) node.classList.remove("guided");
      const node = document.querySelector(part);
      node.classList.add("guided");
      if (node.localName === "details") node.open = true;
      reveal(node);
    }

    byId("left").prepend(card);
    if (others) card.append(el("p.small", el("a", { href: location.pathname }, "Other starts")));
    go(0);
  }

  let isBegun = false;
  store.on("numbers", () => {
    const { guides: found, number = 0 } = store.hello;
    if (isBegun || !found) return;
    isBegun = true;
    if (new URLSearchParams(location.search).has("mechanism")) lead(found[number], found.length > 1);
    else choose(found);
  });
}
