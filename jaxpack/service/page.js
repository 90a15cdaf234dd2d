"use strict";

const field = (id) => document.getElementById(id);

/** The rows of a CSV file: cells between commas, semicolons or tabs, quoted or not. */
function rows(text) {
  const header = text.split(/\r?\n/, 1)[0];
  const between = [";", "\t", ","].find((sign) => header.includes(sign)) || ",";
  const all = [];
  let row = [], cell = "", quoted = false;
  for (let at = 0; at <= text.length; at++) {
    const sign = text[at];
    if (quoted && sign !== undefined) {
      if (sign !== '"') cell += sign;
      else if (text[at + 1] === '"') { cell += '"'; at++; } else quoted = false;
    } else if (sign === '"' && !cell) {
      quoted = true;
    } else if (sign === between || sign === "\n" || sign === undefined) {
      row.push(cell.trim());
      cell = "";
      if (sign !== between) {
        if (row.some((text) => text)) all.push(row);
        row = [];
      }
    } else {
      cell += sign;
    }
  }
  // Where a comma does not part cells it is that of a decimal.
  const plain = (text) => between === ";" && /^[+-]?\d+,\d+$/.test(text) ? text.replace(",", ".") : text;
  return all.map((row) => row.map(plain));
}

/** A table as the service takes it: columns. */
async function table(file) {
  const [header, ...lines] = rows((await file.text()).replace(/^\ufeff/, ""));
  if (!header) throw new Error(`${file.name}: the file is empty`);
  return Object.fromEntries(header.map((name, n) => [name, lines.map((line) => line[n] ?? "")]));
}

async function bins() {
  const [file] = field("bins").files;
  if (file) return table(file);
  const sides = ["X", "Y", "Z"].map((name) => [name, [field(name).value]]);
  if (sides.some(([, [value]]) => !value.trim())) throw new Error("give a file of bins, or the sides of one bin");
  return Object.fromEntries(sides);
}

function say(text, wrong = false) {
  field("said").textContent = text;
  field("said").classList.toggle("wrong", wrong);
}

/** Shows what a request of the form gave; text from a file is only ever set as text. */
async function pack() {
  say("packing …");
  const [file] = field("items").files;
  const order = { items: await table(file), bins: await bins(), name: file.name.slice(0, 200) };
  const answer = await fetch("/v1/solve", {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(order),
  });
  const text = await answer.text(), plan = JSON.parse(text);
  if (!answer.ok) throw new Error(plan.detail);
  const counted = (list, what) => `${list.length} ${what}${list.length === 1 ? "" : "s"}`;
  const left = plan.left_out.length ? `, ${counted(plan.left_out, "item")} left out` : "";
  say(`${counted(plan.bins, "bin")}${left}; lower bound ${plan.lower_bound}`);
  URL.revokeObjectURL(field("json").href);
  field("json").href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  field("html").href = field("plan").src = plan.page;
  for (const id of ["json", "html", "plan"]) field(id).hidden = false;
}

field("order").addEventListener("submit", (event) => {
  event.preventDefault();
  pack().catch((error) => say(error.message, true));
});

/** A file may be dropped anywhere: what is not dropped on the bins is the items. */
const places = [...document.querySelectorAll(".drop")];
function dragged(event) {
  event.preventDefault(); // a browser would open it
  const over = places.find((place) => place.contains(event.target)) ?? places[0];
  for (const place of places) place.classList.toggle("over", event.type === "dragover" && place === over);
  const files = event.dataTransfer.files;
  if (event.type === "drop" && files.length) over.querySelector("input").files = files;
}
for (const type of ["dragover", "dragleave", "drop"]) addEventListener(type, dragged);
