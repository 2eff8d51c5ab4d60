// Elements without HTML: every text from outside becomes a text node, so no name can be markup.

const SVG = "http://www.w3.org/2000/svg";

function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, String(value));
  }
  element.append(...children.flat().filter((child) => child != null));
  return element;
}

export function el(tag, attributes = {}, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

export function button(text, act, attributes = {}) {
  return el("button", { type: "button", onclick: act, ...attributes }, text);
}

export function labelled(text, control) {
  return el("label", {}, el("span", {}, text), control);
}

export function select(options, attributes = {}) {
  const pairs = options.map((each) => (Array.isArray(each) ? each : [each, each]));
  return el("select", attributes, pairs.map(([value, text]) => el("option", { value }, text)));
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function download(name, content) {
  const url = URL.createObjectURL(content);
  el("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// Return a list of states of which one is lit.
export function chips(names) {
  const items = new Map(names.map((name) => [name, el("li", { class: name.startsWith("FAULT") ? "chip fault" : "chip" }, name.replaceAll("_", " "))]));
  const root = el("ul", { class: "chips" }, ...items.values());
  let lit = null;
  const light = (name) => {
    if (name === lit) return;
    lit = name;
    for (const [each, item] of items) {
      item.classList.toggle("lit", each === name);
      if (each === name) item.setAttribute("aria-current", "true");
      else item.removeAttribute("aria-current");
    }
  };
  return { root, light };
}
