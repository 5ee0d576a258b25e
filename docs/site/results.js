// The table of results: a filter for its methods, a choice of suites, and the command of the cell that is clicked.
// Without this file the page has every table and command all the same.

function filterOf(table) {
  const heads = [...table.tHead.rows[0].cells].slice(1).map((head) => head.querySelector("a").textContent);
  const bar = document.createElement("form");
  bar.className = "results-filter";
  const text = Object.assign(document.createElement("input"), { type: "search", placeholder: "filter methods, as vfh" });
  text.setAttribute("aria-label", "Filter methods");
  const choice = document.createElement("select");
  choice.setAttribute("aria-label", "Suite");
  for (const name of ["all suites", ...heads]) choice.add(new Option(name, name));
  const command = document.createElement("code");
  command.setAttribute("aria-live", "polite");
  bar.append(text, choice, command);

  const show = () => {
    const column = heads.indexOf(choice.value);
    for (const row of table.tBodies[0].rows) {
      const cells = [...row.cells].slice(1);
      const isEmpty = column >= 0 && !cells[column].dataset.command;
      row.hidden = isEmpty || !row.cells[0].textContent.includes(text.value.trim());
    }
    for (const row of table.rows) {
      [...row.cells].slice(1).forEach((cell, number) => { cell.hidden = column >= 0 && number !== column; });
    }
  };
  text.addEventListener("input", show);
  choice.addEventListener("change", show);
  bar.addEventListener("submit", (event) => event.preventDefault());
  table.addEventListener("click", (event) => {
    const cell = event.target.closest("td[data-command]");
    if (cell) command.textContent = cell.dataset.command;
  });
  return bar;
}

const results = document.getElementById("every-result");
if (results) results.closest(".results").before(filterOf(results));
