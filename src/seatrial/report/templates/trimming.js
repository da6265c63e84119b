for (const box of document.querySelectorAll(".trimmed")) {
  const [begin, end] = box.querySelectorAll("input");
  const [before, after] = box.querySelectorAll(".veils span");
  const first = Number(box.dataset.first), last = Number(box.dataset.last);
  const share = (at) => 100 * (at - first) / (last - first);
  const quoted = (text) => /^[\w.-]+$/.test(text) ? text : JSON.stringify(text);
  for (const part of box.querySelectorAll("[hidden]")) part.hidden = false;
  const show = (moved) => {
    if (Number(begin.value) >= Number(end.value)) {
      if (moved === begin) begin.value = Number(end.value) - Number(begin.step);
      else end.value = Number(begin.value) + Number(end.step);
    }
    before.style.width = share(begin.value) + "%";
    after.style.width = 100 - share(end.value) + "%";
    box.querySelector("output").textContent =
      `seatrial import DIR --run ${quoted(box.dataset.run)} --start "${begin.value} s" --end "${end.value} s"`;
  };
  for (const handle of [begin, end]) handle.addEventListener("input", () => show(handle));
}
