// Elements without markup: text from the server is only ever text.

export const byId = (id) => document.getElementById(id);

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith('on')) made.addEventListener(name.slice(2), value);
    else if (name in made && name !== 'list') made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

export function drawing(tag, attributes = {}, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

/// Changes the text only where it differs: selections, tooltips and readers of the screen stay undisturbed.
export function setText(to, text) {
  if (to.textContent !== text) to.textContent = text;
}

/// 12345 as 12 345, with spaces at which no line ends.
export const grouped = (count) => count.toLocaleString('en').replace(/,/g, '\u00a0');

/// How much of its track a bar fills; by a transform, which lays nothing out.
export function setBar(bar, share) {
  const transform = `scaleX(${Math.min(1, Math.max(0, share || 0)).toFixed(3)})`;
  if (bar.dataset.transform === transform) return;
  bar.dataset.transform = bar.style.transform = transform;
}

export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
