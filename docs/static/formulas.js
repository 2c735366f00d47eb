// Formulas of a page, as Sphinx marks them: \(...\) in a line, \[...\] on their own.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll(".math").forEach((formula) => {
    const text = formula.textContent.trim();
    katex.render(text.slice(2, -2), formula, { displayMode: text.startsWith("\\["), throwOnError: false });
  });
});
