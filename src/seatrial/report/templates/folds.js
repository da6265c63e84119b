addEventListener("beforeprint", () => {
  for (const fold of document.querySelectorAll("details")) fold.open = true;
});
const values = document.getElementById("values");
if (values && navigator.clipboard) {
  const button = document.createElement("button");
  const text = (cell) => (cell.firstChild?.textContent ?? "").trim().replaceAll("\u2212", "-");
  const row = ({ cells: [name, value, ...truth] }) => {
    const [mean, sd = ""] = text(value).split(" \u00b1 ");
    return [name.title, mean, sd, ...truth.map(text), name.querySelector("small").textContent].join("\t");
  };
  button.textContent = "Copy the table";
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText([...values.tBodies[0].rows].map(row).join("\n"));
    button.textContent = "Copied";
  });
  document.getElementById("copy").prepend(button, " ");
}
