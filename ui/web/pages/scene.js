// Put into viser's page: keys of the desk are handed up to it before viser sees them; the keys that
// move viser's camera stay its own.
for (const type of ["keydown", "keyup"]) {
  window.addEventListener(type, (event) => {
    if (/^(INPUT|TEXTAREA|SELECT)$/.test(event.target?.tagName ?? "")) return;
    if (window.parent !== window && window.parent.gruberKey?.(event)) {
      event.preventDefault();
      event.stopImmediatePropagation();
    }
  }, true);
}
