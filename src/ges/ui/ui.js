"use strict";
// What a form cannot do: dropping files, a sentence before a large upload, steps as they end.

for (const form of document.querySelectorAll(".drop")) {
  const input = form.querySelector("input"), say = form.querySelector(".say");
  const send = () => {
    const files = [...input.files];
    const bytes = files.reduce((sum, file) => sum + file.size, 0), limit = Number(form.dataset.limit);
    if (!files.length) return;
    // Names and borders of the parts need room, too.
    if (bytes + 1000 * (files.length + 1) > limit) {
      say.textContent = `These files have ${(bytes / 1e6).toFixed(1)} MB; allowed are ${limit / 1e6} MB together. ` +
        "Drop fewer of them, or start ges ui with a larger --limit.";
    } else if (files.length > Number(form.dataset.most)) {
      say.textContent = `These are ${files.length} files; allowed are ${form.dataset.most} at once.`;
    } else {
      say.textContent = `Reading ${files.map((file) => file.name).join(", ")} …`;
      form.submit();
    }
  };
  input.addEventListener("change", send);
  form.addEventListener("dragover", (event) => { event.preventDefault(); form.classList.add("over"); });
  form.addEventListener("dragleave", () => form.classList.remove("over"));
  form.addEventListener("drop", (event) => {
    event.preventDefault();
    form.classList.remove("over");
    input.files = event.dataTransfer.files;
    send();
  });
}

// A file that misses the field would take the place of the page.
for (const kind of ["dragover", "drop"]) document.addEventListener(kind, (event) => event.preventDefault());

// A field that is filled in chooses the way that it belongs to.
for (const fields of document.querySelectorAll("fieldset .inner")) {
  const radio = fields.previousElementSibling.querySelector("input");
  fields.addEventListener("input", () => { radio.checked = true; });
}

const state = document.querySelector("#state");
if (state) {
  const began = Date.now(), words = state.querySelector(".words"), first = words.textContent.trim();
  setInterval(() => { words.textContent = `${first}, ${Math.round((Date.now() - began) / 1000)} s`; }, 1000);
  const events = new EventSource(state.dataset.events);
  events.addEventListener("step", (event) => {
    const step = JSON.parse(event.data), row = document.querySelector("#steps").insertRow();
    row.insertCell().textContent = step.what;
    const seconds = row.insertCell();
    seconds.className = "number";
    seconds.textContent = `${step.seconds.toFixed(1)} s`;
  });
  events.addEventListener("over", () => { events.close(); location.reload(); });
}

const save = document.querySelector("#save");
if (save) {
  const text = document.querySelector("pre code").textContent;
  save.href = URL.createObjectURL(new Blob([text], { type: "application/yaml" }));
  save.hidden = false;
}

const back = document.querySelector("#back");
if (back && document.referrer.startsWith(location.origin)) back.href = document.referrer;
