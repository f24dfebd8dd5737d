// What is wrong with the picture of a page: words that are cut, labels and words over others, the
// tool at the edge, a page wider than its window.
() => {
    const found = [];
    const name = (node) => `${node.id ? "#" + node.id : "." + node.className} "${node.textContent.trim().slice(0, 40)}"`;
    const seen = (node) => node.checkVisibility({ visibilityProperty: true, opacityProperty: true });
    const hides = (overflow) => overflow === "hidden" || overflow === "clip";
    // Whether a line of words ends below a box that hides it; one that is scrolled shows it in time.
    const cut = (words) => {
        const range = document.createRange();
        range.selectNodeContents(words);
        const { bottom, height } = range.getBoundingClientRect();
        for (let box = words.parentElement; height && box; box = box.parentElement) {
            const { overflowY } = getComputedStyle(box);
            if (/auto|scroll/.test(overflowY)) return false;
            const inside = box.getBoundingClientRect();
            if (hides(overflowY) && inside.height && bottom > inside.bottom + 3) return true;
        }
        return false;
    };
    for (const node of document.querySelectorAll("body *")) {
        if (!seen(node) || node.closest("svg")) continue;
        const { overflowX } = getComputedStyle(node);
        const words = [...node.childNodes].filter((child) => child.nodeType === 3 && child.data.trim());
        if (node.scrollWidth > node.clientWidth && hides(overflowX) && node.clientWidth) found.push(`cut: ${name(node)}`);
        if (words.some(cut)) found.push(`cut below: ${name(node)}`);
        if (node.matches("select") && !node.matches(".save")) {
            const pen = document.createElement("canvas").getContext("2d");
            pen.font = getComputedStyle(node).font;
            const text = node.selectedOptions[0]?.text ?? "";
            const arrow = 22; // with the space around both
            if (pen.measureText(text).width + arrow > node.clientWidth) found.push(`cut: select "${text}"`);
        }
    }
    if (document.documentElement.scrollWidth > innerWidth) found.push("the page is wider than its window");
    // Boxes of words over the picture.
    const boxes = ["#cameras", "#show summary", "#legend", "#colour-bar"].map((part) => document.querySelector(part))
        .filter((node) => node && seen(node)).map((node) => [name(node), node.getBoundingClientRect()]);
    const { pane } = window.cartstiff;
    const { viewer } = pane;
    viewer.render();
    const canvas = viewer.renderer.domElement.getBoundingClientRect();
    const labels = [];
    viewer.scene.traverseVisible((node) => {
        if (!node.isSprite || !node.material.visible) return;
        const at = node.position.clone().setFromMatrixPosition(node.matrixWorld).project(viewer.camera);
        if (Math.abs(at.z) > 1) return;
        const [sx, , , , , sy] = viewer.camera.projectionMatrix.elements;
        const [w, h] = [0, 4].map((k) => Math.hypot(...node.matrixWorld.elements.slice(k, k + 3)));
        const [x, y] = [(at.x + 1) / 2 * canvas.width + canvas.left, (1 - at.y) / 2 * canvas.height + canvas.top];
        const [width, height] = [w * sx / 2 * canvas.width, h * sy / 2 * canvas.height];
        const left = x - node.center.x * width;
        const top = y - (1 - node.center.y) * height;
        const path = [];
        for (let up = node; up && up.name !== "cartstiff"; up = up.parent) path.unshift(up.name);
        labels.push([`label ${path.join("/")}`, { left, top, right: left + width, bottom: top + height }]);
    });
    for (const [label, { left, top, right, bottom }] of labels) {
        if (left < canvas.left - 1 || right > canvas.right + 1 || top < canvas.top - 1 || bottom > canvas.bottom + 1) found.push(`cut: ${label}`);
    }
    const tool = viewer.scene_tree.find(["meshcat", "cartstiff", "M"]).object; // the shape at rest has an M, too
    const p = viewer.camera.position.clone().setFromMatrixPosition(tool.matrixWorld).project(viewer.camera);
    const [mx, my] = [(p.x + 1) / 2 * canvas.width + canvas.left, (1 - p.y) / 2 * canvas.height + canvas.top];
    for (const [label, { left, top, right, bottom }] of labels) {
        if (/ellipsoid|wrench/.test(label) && mx > left && mx < right && my > top && my < bottom) found.push(`over M: ${label}`);
        if (bottom - top < 14) found.push(`small: ${label} (${(bottom - top).toFixed(1)} high)`);
    }
    const all = [...boxes, ...labels];
    all.forEach(([one, a], i) => {
        for (const [other, b] of all.slice(0, i)) {
            const [x, y] = [Math.min(a.right, b.right) - Math.max(a.left, b.left), Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top)];
            if (x > 1 && y > 1) found.push(`over each other: ${other}, ${one} (${x.toFixed(0)} x ${y.toFixed(0)})`);
        }
    });
    if (Math.max(Math.abs(p.x), Math.abs(p.y)) > 0.95) found.push(`the tool is at the edge: ${p.x.toFixed(2)}, ${p.y.toFixed(2)}`);
    return found;
}
