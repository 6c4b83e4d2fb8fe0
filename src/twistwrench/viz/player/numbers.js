// Numbers in words, to the character as twistwrench prints them: its core/numbers, where ties go to even digits.
"use strict";

const MISSING = "–", DIGITS = 4, IN_FULL = 1e6;

function fixed(x, decimals) { // Python's f"{x:.{decimals}f}": toFixed, but half goes to even
  if (Object.is(x, -0)) return `-${fixed(0, decimals)}`;
  const text = x.toFixed(decimals), long = Math.abs(x).toFixed(Math.min(100, decimals + 60)), point = long.indexOf(".");
  if (!/^50*$/.test(long.slice(point + 1 + decimals))) return text;
  const [low, high] = [long.slice(0, point + 1 + decimals).replace(/\.$/, ""), text.replace("-", "")];
  return (x < 0 ? "-" : "") + (Number(low.slice(-1)) % 2 ? high : low);
}

function exponential(x, digits) { // Python's f"{x:.{digits - 1}e}", as mantissa and exponent
  const at = decade(x), scale = 10 ** Math.max(0, at - digits + 1), text = fixed(x / scale, Math.max(0, digits - 1 - at));
  return (Number(text) * scale).toExponential(digits - 1).split("e");
}

function general(x, digits) { // Python's f"{x:.{digits}g}"
  if (!x) return "0";
  const [mantissa, power] = exponential(x, digits), exponent = Number(power);
  if (exponent >= -4 && exponent < digits) return trimmed(fixed(x, digits - 1 - exponent));
  return `${trimmed(mantissa)}e${power[0]}${power.slice(1).padStart(2, "0")}`;
}
const trimmed = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
const decade = (x) => Number(x.toExponential().split("e")[1]); // floor of log10 |x|

function number(value, digits = DIGITS, decimals = null) {
  if (value === null || !Number.isFinite(value)) return MISSING;
  const x = (decimals === null ? value : Number(fixed(value, decimals))) + 0;
  return 10 ** digits - 0.5 <= Math.abs(x) && Math.abs(x) < IN_FULL ? fixed(x, 0) : general(x, digits);
}

function roundedDown(value) {
  if (!(value > 0 && value < Infinity)) return number(value);
  const step = 10 ** (decade(value) - DIGITS + 1);
  return number(Math.floor((value / step) * (1 + 1e-12)) * step);
}

function torqueText(value) {
  const size = Math.abs(value);
  if (!(size >= 5e-4 && size < IN_FULL)) return number(value, DIGITS, 3);
  return fixed(value, Math.min(Math.max(DIGITS - 1 - decade(size), 0), 3));
}

function percent(share, digits = null) {
  const x = 100 * share;
  if (!Number.isFinite(x)) return MISSING;
  return `${digits === null && Math.abs(x) < IN_FULL ? fixed(x, 0) : number(x, digits ?? DIGITS)} %`;
}

function percentOfLimit(share) {
  if (!(Math.abs(share) > 0.99 && Math.abs(share) < 1.01)) return percent(share);
  const tried = [0, 1, 2, 3, 4].map((decimals) => fixed(100 * share, decimals));
  return `${tried.find((text) => Math.abs(Number(text)) !== 100) ?? tried[0]} %`;
}

function deviation(sigma, decimals = 3) {
  if (!Number.isFinite(sigma)) return MISSING;
  const least = 10 ** -decimals;
  if (sigma < 0.5 * least) return sigma > 0 ? `<${fixed(least, decimals)}` : "0";
  if (sigma >= IN_FULL) return number(sigma, 2);
  const two = Number(exponential(sigma, 2).join("e")), places = 1 - decade(two);
  return fixed(two, Math.min(Math.max(places, 0), decimals));
}

const seconds = (time) => fixed(time, 3);

function listed(items, most, between = ", ") {
  const more = items.length - most;
  return items.slice(0, most).join(between) + (more > 0 ? `${between.trimEnd().replace(/^,|,$/g, "")} and ${more} more` : "");
}
