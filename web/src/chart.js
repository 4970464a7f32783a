// Speed over time, and what the robot believes, drawn on two canvases by the page's own colours.

const SPAN = 20; // seconds
const FAST = 0.9; // m/s at the top

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function sized(canvas) {
  const ratio = window.devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
  const [across, down] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== across || canvas.height !== down) Object.assign(canvas, { width: across, height: down });
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = '11px system-ui, sans-serif';
  return { pen, width, height };
}

/** Speed of the last twenty seconds, with what happened marked on it. */
export function drawSpeed(canvas, story) {
  const { pen, width, height } = sized(canvas), now = story.time;
  const X = (t) => width * (1 - (now - t) / SPAN), Y = (v) => height - 8 - ((height - 42) * Math.max(-0.05, v)) / FAST;
  pen.fillStyle = colour('--muted');
  pen.strokeStyle = colour('--line');
  for (const v of [0, 0.4, 0.8]) {
    line(pen, [[0, Y(v)], [width, Y(v)]]);
    pen.fillText(v ? `${v} m/s` : '0', 2, Y(v) - 2);
  }
  pen.strokeStyle = pen.fillStyle = colour('--mark');
  let last = -Infinity, row = 0;
  for (const { time, text } of story.marks) {
    const x = X(time);
    row = x - last < 90 ? (row + 1) % 3 : 0;
    last = x;
    line(pen, [[x, 0], [x, height]]);
    pen.fillText(text, x + 3, 10 + 11 * row);
  }
  pen.strokeStyle = colour('--accent');
  pen.lineWidth = 2;
  const first = Math.max(1, story.past.length - SPAN * 20);
  line(pen, story.past.slice(first).map((point, i) => [X(point.time), Y(story.speed(first + i))]));
  pen.lineWidth = 1;
}

function line(pen, points) {
  pen.beginPath();
  points.forEach(([x, y]) => pen.lineTo(x, y));
  pen.stroke();
}

/** The likeliest damages as bars. */
export function drawBelief(canvas, mind) {
  const { pen, width, height } = sized(canvas), rows = mind.likely(4), step = height / rows.length;
  rows.forEach(({ name, share }, i) => {
    pen.fillStyle = colour('--bar');
    pen.fillRect(0, i * step + 2, Math.max(1, share * width), step - 4);
    pen.fillStyle = colour('--ink');
    pen.fillText(`${name}  ${share.toFixed(2)}`, 6, i * step + step / 2 + 4);
  });
}
