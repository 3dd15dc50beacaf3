// Forms for the commands that the host knows.

export function buildCommands(room, commands, send) {
  room.replaceChildren(...commands.map(command => formOf(command, send)));
}

function formOf(command, send) {
  const details = document.createElement("details"), summary = document.createElement("summary");
  const form = document.createElement("form"), help = document.createElement("p"), button = document.createElement("button");
  summary.textContent = command.name;
  help.textContent = [command.help, command.limits].filter(Boolean).join("; ");
  button.textContent = `Send ${command.name}`;
  form.append(help, ...command.values.flatMap(fieldOf), button);
  form.dataset.command = command.name;
  form.addEventListener("submit", event => {
    event.preventDefault();
    send({kind: "command", name: command.name, values: valuesOf(form)});
  });
  details.append(summary, form);
  return details;
}

function fieldOf(value) {
  const label = document.createElement("label"), unit = document.createElement("small");
  const input = value.choices ? choice(Object.keys(value.choices)) : document.createElement("input");
  label.textContent = value.name.replaceAll("_", " ");
  label.title = value.help;
  unit.textContent = value.unit;
  input.name = value.name;
  if (!value.choices) {
    input.inputMode = "decimal";
    input.required = value.default === null;
    input.value = value.default ?? "";
    input.title = `${value.low} to ${value.high} ${value.unit}`;
  }
  return [label, input, unit];
}

function choice(names) {
  const select = document.createElement("select");
  select.append(...names.map(name => new Option(name, name)));
  return select;
}

function valuesOf(form) {
  const given = [...new FormData(form)].filter(([, text]) => text.trim() !== "");
  return Object.fromEntries(given.map(([name, text]) => [name, Number.isFinite(Number(text)) ? Number(text) : text]));
}
