// In which units values are shown, by their SI unit: those of `hil-bench ctl`, and % for shares.

const SHOWN = {
  Pa: { symbol: "bar", factor: 1e5, digits: 1, least: 2 },
  m: { symbol: "mm", factor: 1e-3, digits: 2, least: 1 },
  "m/s": { symbol: "mm/s", factor: 1e-3, digits: 1, least: 2 },
  "-": { symbol: "%", factor: 1e-2, digits: 1, least: 2 },
};

export function shown(unit) {
  return SHOWN[unit] ?? { symbol: unit, factor: 1, digits: 3, least: 1e-3 };
}

export function valueText(value, unit) {
  const { factor, digits } = shown(unit);
  if (value == null || !Number.isFinite(value)) return "no value";
  const text = (value / factor).toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text; // no -0.0
}
