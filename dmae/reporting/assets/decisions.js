// Decisions on the rows of a table, saved as a JSON file.
"use strict";

function decisionsOf(table) {
  const chosen = [...table.querySelectorAll("select.verdict")].filter((select) => select.value);
  return chosen.map((select) => ({...JSON.parse(select.dataset.choice), verdict: select.value}));
}

function decidable(table) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "save";
  const label = () => {
    const count = decisionsOf(table).length;
    button.disabled = !count;
    button.textContent = `Save ${table.dataset.name} (${count} of ${table.tBodies[0].rows.length} decided)`;
  };
  table.addEventListener("change", label);
  button.addEventListener("click", () => {
    const content = JSON.parse(table.dataset.file);
    content.decisions.push(...decisionsOf(table));
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([JSON.stringify(content, null, 1), "\n"], {type: "application/json"}));
    link.download = table.dataset.name;
    link.click();
    URL.revokeObjectURL(link.href);
  });
  label();
  table.after(button);
}

for (const table of document.querySelectorAll("table[data-file]")) decidable(table);
