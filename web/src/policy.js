// Policies: observation -> action in [-1, 1]. The same arithmetic as srl_jax/portable.py.

const EPSILON = 1e-6; // of LayerNorm, as flax has it

/** A network with hidden layers of Dense, LayerNorm (where it has one) and ReLU, and a last one of Dense and tanh. */
export class Network {
  constructor({ layers }) {
    this.layers = layers.map(({ kernel, bias, scale, shift }) => ({
      kernel: decode(kernel), bias: decode(bias), scale: scale && decode(scale), shift: shift && decode(shift),
    }));
    this.layers.forEach((layer) => { layer.out = new Float64Array(layer.bias.length); });
  }

  act(observation) {
    let x = observation;
    this.layers.forEach((layer, number) => {
      dense(layer, x);
      if (number === this.layers.length - 1) layer.out.forEach((v, j, out) => { out[j] = Math.tanh(v); });
      else {
        if (layer.scale) normalise(layer);
        layer.out.forEach((v, j, out) => { out[j] = Math.max(0, v); });
      }
      x = layer.out;
    });
    return x;
  }
}

function dense({ kernel, bias, out }, x) {
  const width = bias.length;
  out.set(bias);
  for (let i = 0; i < x.length; i++) for (let j = 0; j < width; j++) out[j] += x[i] * kernel[i * width + j];
}

function normalise({ out, scale, shift }) {
  const count = out.length;
  const mean = out.reduce((sum, v) => sum + v, 0) / count;
  const variance = Math.max(out.reduce((sum, v) => sum + v * v, 0) / count - mean * mean, 0);
  const inverse = 1 / Math.sqrt(variance + EPSILON);
  for (let j = 0; j < count; j++) out[j] = (out[j] - mean) * inverse * scale[j] + shift[j];
}

/** The scripted tripod, see srl_jax/env/gait.py; `gait` has its parameters, `mount` and `tripod` six angles and phases. */
export class Tripod {
  constructor({ gait, mount, tripod }) { Object.assign(this, { gait, mount, tripod, out: new Float64Array(18) }); }

  act(observation) {
    const { gait: g, mount, tripod, out } = this;
    const clock = Math.atan2(observation[0], observation[1]);
    const [ahead, left] = [observation[2], observation[3]];
    for (let leg = 0; leg < 6; leg++) {
      const across = left * Math.cos(mount[leg]) - ahead * Math.sin(mount[leg]);
      const along = ahead * Math.cos(mount[leg]) + left * Math.sin(mount[leg]);
      const angle = clock + 2 * Math.PI * tripod[leg];
      const swing = Math.max(Math.sin(angle - 2 * Math.PI * g.lag), 0);
      const forward = -Math.cos(angle);
      out[3 * leg] = (g.stride * across + g.turn * left) * forward;
      out[3 * leg + 1] = g.lift * swing + g.level * along * forward - g.press;
      out[3 * leg + 2] = g.tuck * swing + g.reach * along * forward + g.crouch;
    }
    out.forEach((v, j) => { out[j] = Math.min(1, Math.max(-1, v)); });
    return out;
  }
}

export const makePolicy = (policy) => (policy.gait ? new Tripod(policy) : new Network(policy));

/** Numbers of half precision, little-endian in base64. */
export function decode(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float64Array.from({ length: bytes.length / 2 }, (_, i) => half(view.getUint16(2 * i, true)));
}

function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}
