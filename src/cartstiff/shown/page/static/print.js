// A picture or a plot for print: how wide, of what kind, with what.

import { button, byId, choice, el, heading, hint } from "./dom.js";

// Width of a column of text (mm), and ends of what may be asked for.
const [COLUMN, NARROWEST, WIDEST] = [85, 20, 400];

/** Ask for it, and give `save` the kind of the file. */
export function askPrint(title, save, { isPlot = false, hasOthers = false } = {}) {
  const dialog = byId("report");
  dialog.setAttribute("aria-label", title);
  const width = el("input", { type: "number", id: "print-width", value: COLUMN, min: NARROWEST, max: WIDEST });
  const box = (words, checked) => {
    const input = el("input", { type: "checkbox", checked });
    return { input, node: el("label.check", input, words) };
  };
  const [clear, caption, all] = [box("without a ground", false), box("with a caption", true),
    box("all pictures side by side", true)];
  let form = "mm";
  const [forms, choose] = choice("Kind of file", [["mm", "PNG, 300 dpi"], ["svg", "SVG"]],
    (value) => { form = value; });
  choose(form);
  const act = () => {
    if (!width.reportValidity() || !(width.valueAsNumber > 0)) return;
    dialog.close();
    save([`${form}${width.valueAsNumber}`, clear.input.checked && "clear", !caption.input.checked && "bare",
      !all.input.checked && "alone"].filter(Boolean).join(" "));
  };
  dialog.replaceChildren(heading(title, button("Close", () => dialog.close())),
    el("label.line", el("span", "width"), width, el("span.dim", "mm")),
    ...(isPlot ? [forms] : []), clear.node, caption.node, ...(hasOthers ? [all.node] : []),
    hint("The caption says what moves how far, and which springs are assumed."),
    button("Save", act, { class: "primary" }));
  dialog.showModal();
}
