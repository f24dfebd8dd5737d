// A picture or a plot for print: how wide, of what kind, with what.

import { button, checkbox, choice, el, hint, openDialog } from "./dom.js";

// Width of a column of text (mm), and ends of what may be asked for.
const [COLUMN, NARROWEST, WIDEST] = [85, 20, 400];

/** Ask for it, and give `save` the kind of the file. */
export function askPrint(title, save, { isPlot = false, hasOthers = false } = {}) {
  const width = el("input", { type: "number", id: "print-width", value: COLUMN, min: NARROWEST, max: WIDEST });
  const [clear, caption, all] = ["without a ground", "with a caption", "all pictures side by side"]
    .map((words) => checkbox(words, () => {}));
  caption.control.checked = all.control.checked = true;
  let form = "mm";
  const [forms, choose] = choice("Kind of file", [["mm", "PNG, 300 dpi"], ["svg", "SVG"]],
    (value) => { form = value; });
  choose(form);
  const dialog = openDialog("report", title, el("label.line", el("span", "width"), width, el("span.dim", "mm")),
    ...(isPlot ? [forms] : []), clear, caption, ...(hasOthers ? [all] : []),
    hint("The caption says what moves how far, and which springs are assumed."),
    button("Save", () => {
      if (!width.reportValidity() || !(width.valueAsNumber > 0)) return;
      dialog.close();
      save([`${form}${width.valueAsNumber}`, clear.control.checked && "clear", !caption.control.checked && "bare",
        !all.control.checked && "alone"].filter(Boolean).join(" "));
    }, { class: "primary" }));
}
