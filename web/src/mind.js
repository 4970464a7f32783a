// How the robot finds out: a bank of observers, a hidden Markov model over damages, and the best policy under it.
// The equations of srl_jax/atlas (tracking, belief, choice); all their numbers come with the page.
import { Body, rotation } from './robot.js';

const LARGE = 10;
const logsumexp = (x) => { const top = Math.max(...x); return top + Math.log(x.reduce((sum, v) => sum + Math.exp(v - top), 0)); };
const softmax = (x) => { const total = logsumexp(x); return x.map((v) => Math.exp(v - total)); };

export class Mind {
  constructor(mj, page) {
    this.page = page;
    this.atlas = page.atlas;
    this.bodies = this.atlas.damages.map((damage) => { const body = new Body(mj, page); body.wear(damage); return body; });
    this.forget();
  }

  /** Surely healthy, and every hypothesis' robot stands. */
  forget() {
    const count = this.bodies.length, even = -Math.log(count + 1);
    this.bodies.forEach((body) => body.stand());
    this.even = Array(count + 1).fill(even);
    const sure = this.atlas.prior_healthy;
    this.belief = this.even.map((v, d) => (d === 0 ? Math.log(sure + (1 - sure) * Math.exp(v)) : Math.log(1 - sure) + v));
    this.held = 0;
    this.policy = this.best(0);
  }

  best(column) { return argmax(this.atlas.value.map((row) => row[column])); }

  /** After a control step under `action`: what was felt is told to every hypothesis. */
  doubt(action, felt, answering) {
    const { likelihood: own } = this.atlas, { substeps } = this.page;
    const odds = Math.log(own.mistaken) - Math.log1p(-own.mistaken);
    let strange = -Infinity;
    const evidence = this.bodies.map((body) => {
      const before = [Array.from(body.data.qpos), Array.from(body.data.qvel)];
      body.aim(action);
      for (let i = 0; i < substeps; i++) body.substep();
      const error = this.residual(body, felt, answering);
      const unexpected = body.present.filter((there, i) => there !== answering[i]).length;
      const square = Math.min(this.square(error), own.most);
      correct(body, error, felt, this.atlas.gains, this.page.control_hz);
      if (!sound(body)) { body.data.qpos.set(before[0]); body.data.qvel.set(before[1]); }
      const vaguely = (-0.5 * square) / own.vague ** 2 - felt.length * Math.log(own.vague);
      strange = Math.max(strange, vaguely / own.tempering + odds * Math.min(unexpected, 1));
      return (-0.5 * square) / own.tempering + odds * unexpected;
    });
    const hazard = Math.log(own.hazard), stay = Math.log1p(-own.hazard);
    const total = [...evidence, strange].map((v, d) => v + logsumexp([stay + this.belief[d], hazard + this.even[d]]));
    const sum = logsumexp(total);
    this.belief = total.map((v) => v - sum);
  }

  residual(body, felt, answering) {
    const predicted = body.felt();
    return felt.map((v, i) => {
      if (i < 18 && !(answering[i] && body.present[i])) return 0;
      return Number.isFinite(v - predicted[i]) ? v - predicted[i] : LARGE;
    });
  }

  square(error) {
    return this.atlas.whitening.reduce((sum, row) => sum + row.reduce((s, w, i) => s + w * error[i], 0) ** 2, 0);
  }

  /** What every policy is worth under the belief, as a share of the healthy speed. */
  worth() {
    const known = this.belief.slice(0, -1), strange = Math.exp(this.belief.at(-1));
    const sharp = softmax(known), flat = softmax(known.map((v) => v / this.atlas.flat));
    const weight = sharp.map((v, d) => (1 - strange) * v + strange * flat[d]);
    return this.atlas.value.map((row) => row.reduce((sum, v, d) => sum + v * weight[d], 0));
  }

  /** Who walks on: the best where a segment is over, or at once where the present one is clearly worse. */
  choose() {
    const worth = this.worth(), best = argmax(worth);
    this.held += 1;
    if (this.held >= this.atlas.pace.hold || worth[best] - worth[this.policy] > this.atlas.pace.margin) {
      this.policy = best;
      this.held = 0;
    }
    return this.atlas.trained_for[this.policy];
  }

  /** The likeliest hypotheses with their probabilities, best first; the last place is 'none of these'. */
  likely(count) {
    const names = [...this.atlas.damages, 'none of these'];
    return this.belief.map((v, d) => ({ name: names[d], share: Math.exp(v) })).sort((a, b) => b.share - a.share).slice(0, count);
  }

  free() { this.bodies.forEach((body) => body.free()); }
}

const sound = ({ data }) => data.qpos.every(Number.isFinite) && data.qvel.every(Number.isFinite);
const argmax = (x) => x.reduce((best, v, i) => (v > x[best] ? i : best), 0);

/** Leads a hypothesis' robot back by shares of its residual, as an observer is. */
function correct(body, error, felt, gains, hz) {
  const { qpos, qvel } = body.data;
  const R = rotation(qpos.subarray(3, 7)), vertical = [-R[6], -R[7], -R[8]], gravity = felt.slice(21);
  const turn = cross(gravity, vertical).map((v) => 0.5 * gains.tilt * v);
  const q = product(Array.from(qpos.subarray(3, 7)), [1, ...turn]), norm = Math.hypot(...q);
  q.forEach((v, i) => { qpos[3 + i] = v / norm; });
  for (let i = 0; i < 18; i++) {
    qpos[7 + i] += gains.joints * error[i];
    qvel[6 + i] += gains.speeds * hz * error[i];
  }
  for (let i = 0; i < 3; i++) qvel[3 + i] += gains.gyroscope * error[18 + i];
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function product(a, b) {
  const [v, u] = [a.slice(1), b.slice(1)], c = cross(v, u);
  return [a[0] * b[0] - v[0] * u[0] - v[1] * u[1] - v[2] * u[2], ...v.map((_, i) => a[0] * u[i] + b[0] * v[i] + c[i])];
}
