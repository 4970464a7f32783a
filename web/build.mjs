// Makes srl_jax/demo/template.html: one file, without policies, that srl-jax demo fills. Run by `make demo-template`.
import { build } from 'esbuild';
import { createHash } from 'node:crypto';
import { readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { gzipSync } from 'node:zlib';

const OUT = new URL('../srl_jax/demo/template.html', import.meta.url);
const read = (path) => readFileSync(new URL(path, import.meta.url));

/** A WebAssembly binary without its custom sections: names for debuggers are more than half of it. */
function stripped(binary) {
  const kept = [binary.subarray(0, 8)];
  const number = (at) => {
    let value = 0, scale = 1, byte;
    do { byte = binary[at++]; value += (byte & 127) * scale; scale *= 128; } while (byte & 128);
    return [value, at];
  };
  for (let at = 8; at < binary.length;) {
    const [size, body] = number(at + 1);
    if (binary[at] !== 0) kept.push(binary.subarray(at, body + size));
    at = body + size;
  }
  return Buffer.concat(kept);
}

/** What the template was made of; srl_jax/demo tests it against the sources. */
function fingerprint() {
  const hash = createHash('sha256');
  const names = [...readdirSync(new URL('src', import.meta.url)).sort().map((name) => `src/${name}`), 'build.mjs', 'package.json'];
  for (const name of names) hash.update(name).update('\0').update(read(name)).update('\0');
  return hash.digest('hex');
}

const bundle = await build({
  entryPoints: [new URL('src/main.js', import.meta.url).pathname],
  bundle: true, minify: true, format: 'esm', target: 'es2022', write: false, legalComments: 'none',
  external: ['module', 'fs', 'path', 'url'],
  alias: { 'three/addons': new URL('node_modules/three/examples/jsm', import.meta.url).pathname },
});
const script = bundle.outputFiles[0].text.replaceAll('</script', '<\\/script');
const wasm = gzipSync(stripped(read('node_modules/@mujoco/mujoco/mujoco.wasm')), { level: 9 }).toString('base64');
writeFileSync(OUT, `<!doctype html>
<html lang="en">
<!-- sources ${fingerprint()} -->
<!-- MuJoCo (Apache-2.0, Google DeepMind) and three.js (MIT, three.js authors): texts beside this file in LICENSES.txt -->
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Cut off a leg</title>
<link rel="icon" href="data:,">
<style>${read('src/page.css')}</style>
<body>
${read('src/page.html')}
<script type="text/plain" id="payload">@@PAYLOAD@@</script>
<script type="text/plain" id="wasm">${wasm}</script>
<script type="module">${script}</script>
</body>
</html>
`);
console.log(`${OUT.pathname}: ${(readFileSync(OUT).length / 1e6).toFixed(2)} MB`);
