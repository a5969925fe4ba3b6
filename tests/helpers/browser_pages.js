// What is wrong with a page as it stands; each entry is a line for the tester.
() => {
  const seen = (e) => e.getClientRects().length && getComputedStyle(e).visibility !== "hidden"
    && !e.closest("[hidden], .visually-hidden") && getComputedStyle(e).clip !== "rect(0px, 0px, 0px, 0px)";
  const pen = Object.assign(document.createElement("canvas"), { width: 1, height: 1 })
    .getContext("2d", { willReadFrequently: true });
  const known = {};
  const rgba = (colour) => known[colour] ||= (() => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = colour; pen.fillRect(0, 0, 1, 1);
    const d = pen.getImageData(0, 0, 1, 1).data;
    return [d[0], d[1], d[2], d[3] / 255];
  })();
  const over = (top, under) => [0, 1, 2].map((i) => top[i] * top[3] + under[i] * (1 - top[3])).concat(1);
  const ground = (e) => {
    const layers = [];
    for (; e; e = e.parentElement) {
      const c = rgba(getComputedStyle(e).backgroundColor);
      if (c[3]) layers.push(c);
      if (c[3] === 1) break;
    }
    return layers.reverse().reduce((under, top) => over(top, under), [255, 255, 255, 1]);
  };
  // relative luminance and contrast, WCAG 2.2
  const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => {
    const x = c[i] / 255;
    return sum + w * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  }, 0);
  const contrast = (a, b) => {
    const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const wrong = new Set();
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let counted = 0;
  for (let node; (node = texts.nextNode());) {
    const e = node.parentElement;
    if (!node.data.trim() || ["SCRIPT", "STYLE", "NOSCRIPT"].includes(e.tagName) || !seen(e)) continue;
    counted += 1;
    const style = getComputedStyle(e), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && parseInt(style.fontWeight) >= 700);
    const under = ground(e), ratio = contrast(over(rgba(style.color), under), under);
    if (ratio < (large ? 3 : 4.5))
      wrong.add(`contrast ${ratio.toFixed(2)}: <${e.tagName.toLowerCase()} class="${e.className}"> `
        + `${style.color} "${node.data.trim().slice(0, 30)}"`);
  }
  for (const image of document.images) {
    if (!image.hasAttribute("alt")) wrong.add(`an image without alt: ${image.src.slice(0, 80)}`);
    if (image.getAttribute("alt") === "" && !image.closest("a, td, [aria-hidden]"))
      wrong.add(`an image that says nothing: ${image.src.slice(0, 80)}`);
    if (seen(image) && image.complete && !image.naturalWidth) wrong.add(`a broken image: ${image.src.slice(0, 80)}`);
  }
  for (const canvas of document.querySelectorAll("canvas"))
    if (!(canvas.getAttribute("aria-label") || "").trim()) wrong.add("a canvas without a name");
  const out = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (out > 0) {
    const widest = [...document.body.querySelectorAll("*")].filter(
      (e) => seen(e) && e.getBoundingClientRect().right > document.documentElement.clientWidth + 1
        && !e.closest(".scroll, pre, .table-wrapper"));
    wrong.add(`${out} px stick out at ${innerWidth}: `
      + widest.slice(0, 3).map((e) => `<${e.tagName} class="${e.className}">`).join(" "));
  }
  if (!document.title.trim()) wrong.add("no title");
  if (!document.documentElement.lang) wrong.add("no language");
  if (document.querySelectorAll("h1").length !== 1) wrong.add("not one h1");
  if (!counted) wrong.add("no text");
  if (window.bad) wrong.add("text of a file was run");
  return [...wrong];
}
