// Formulas of a page, as Sphinx marks them.
document.addEventListener("DOMContentLoaded", () => {
  const delimiters = [
    { left: "\\(", right: "\\)", display: false },
    { left: "\\[", right: "\\]", display: true },
  ];
  document.querySelectorAll(".math").forEach((formula) => renderMathInElement(formula, { delimiters }));
});
