// Decimals of numbers as Python prints them, where ties go to even digits.
"use strict";

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
