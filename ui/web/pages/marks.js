// What is drawn over pictures: lines with a dark rim, crosses, words; all in css pixels.

export function canvas(canvasElement) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvasElement.clientWidth, canvasElement.clientHeight];
  if (canvasElement.width !== Math.round(width * ratio) || canvasElement.height !== Math.round(height * ratio)) {
    canvasElement.width = Math.round(width * ratio);
    canvasElement.height = Math.round(height * ratio);
  }
  const context = canvasElement.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

export function halo(context, colour, width, path) {
  for (const [ink, wide] of [["#000000b0", width + 2], [colour, width]]) {
    context.beginPath();
    path();
    context.strokeStyle = ink;
    context.lineWidth = wide;
    context.stroke();
  }
}

export function measuredMark(context, [x, y], colour) {
  halo(context, colour, 1.8, () => {
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + dx * 4, y + dy * 4);
      context.lineTo(x + dx * 15, y + dy * 15);
    }
  });
  context.fillStyle = colour;
  context.fillRect(x - 0.75, y - 0.75, 1.5, 1.5);
}

export function crosshair(context, [x, y], width, height) {
  const [cx, cy] = [Math.round(x) + 0.5, Math.round(y) + 0.5];
  const gap = 7;
  for (const [ink, wide] of [["#00000060", 3], ["#ffffffb8", 1]]) {
    line(context, 0, cy, cx - gap, cy, ink, wide);
    line(context, cx + gap, cy, width, cy, ink, wide);
    line(context, cx, 0, cx, cy - gap, ink, wide);
    line(context, cx, cy + gap, cx, height, ink, wide);
  }
}

export function line(context, x1, y1, x2, y2, colour, width) {
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

export function text(context, words, x, y, colour) {
  context.font = "11px sans-serif";
  context.lineWidth = 3;
  context.strokeStyle = "#000000c0";
  context.strokeText(words, x, y);
  context.fillStyle = colour;
  context.fillText(words, x, y);
}
