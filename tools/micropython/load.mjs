// load(MODULES, EDITION): MicroPython as WebAssembly, with the files of an edition where it imports from. MODULES is the
// folder of npm's modules. An error of MicroPython ends the program.
import fs from 'node:fs';
import path from 'node:path';
import { pathToFileURL } from 'node:url';

export async function load(modules, edition) {
  process.on('uncaughtException', (error) => {
    console.error(error.message); // not the line of source that node shows, which is all of MicroPython
    process.exit(1);
  });
  const file = path.resolve(modules, '@micropython/micropython-webassembly-pyscript/micropython.mjs');
  const { loadMicroPython } = await import(pathToFileURL(file));
  const python = await loadMicroPython({ heapsize: 16 << 20, linebuffer: true, stderr: console.error });
  const copy = (from, to) => {
    python.FS.mkdirTree(to);
    for (const entry of fs.readdirSync(from, { withFileTypes: true })) {
      const [source, target] = [path.join(from, entry.name), `${to}/${entry.name}`];
      if (entry.isDirectory()) copy(source, target);
      else if (entry.name.endsWith('.py')) python.FS.writeFile(target, fs.readFileSync(source));
    }
  };
  copy(edition, '/lib');
  python.runPython("import sys\nsys.path.insert(0, '/lib')");
  return python;
}
