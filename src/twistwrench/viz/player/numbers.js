// Numbers in words, to the character as twistwrench prints them: its core/numbers, where ties go to even digits.
"use strict";

const MISSING = "–", DIGITS = 4, IN_FULL = 1e6;

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
