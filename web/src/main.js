// Unpacks what the page carries, starts MuJoCo, and begins. Everything lies in this one file: nothing is fetched.
import loadMujoco from '@mujoco/mujoco';
import { Page } from './page.js';

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip')));
}

try {
  const wasmBinary = new Uint8Array(await (await unpacked('wasm')).arrayBuffer());
  window.demo = new Page(await loadMujoco({ wasmBinary }), await (await unpacked('payload')).json());
} catch (error) {
  document.getElementById('status').textContent = `This browser cannot show the robot: ${error.message ?? error}`;
  throw error;
}
