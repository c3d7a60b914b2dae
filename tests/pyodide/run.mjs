// node run.mjs PACKAGES ARGUMENTS...: pytest with these arguments on the CPython of Pyodide, in this repository.
//
// PACKAGES is the directory that `run` fills: node_modules, and site with pytest in pure Python. Both directories are
// those of this machine; nothing is loaded from a network. The exit status is that of pytest.

import path from 'node:path';
import { fileURLToPath, pathToFileURL } from 'node:url';
import { Worker, isMainThread, workerData } from 'node:worker_threads';

// In a thread of its own, because the stack of the main one is too small for the calls of pytest within hypothesis.
if (isMainThread) {
  const settings = { workerData: process.argv.slice(2), resourceLimits: { stackSizeMb: 128 } };
  new Worker(fileURLToPath(import.meta.url), settings).on('exit', (status) => process.exit(status));
} else {
  const [packages, ...pytest] = workerData;
  const root = path.dirname(path.dirname(path.dirname(fileURLToPath(import.meta.url))));
  const modules = path.resolve(packages, 'node_modules', 'pyodide');
  const { loadPyodide } = await import(pathToFileURL(path.join(modules, 'pyodide.mjs')));
  // Pyodide reads and writes by file descriptor, and streams of a thread do not say theirs.
  [process.stdin, process.stdout, process.stderr].forEach((stream, fd) => (stream.fd ??= fd));
  const env = { HOME: '/tmp', BAREWIRE_NO_SKIPS: process.env.BAREWIRE_NO_SKIPS ?? '' };
  const python = await loadPyodide({ indexURL: modules, env });
  for (const [here, there] of [[root, '/barewire'], [path.resolve(packages, 'site'), '/site']]) {
    python.FS.mkdirTree(there);
    python.FS.mount(python.FS.filesystems.NODEFS, { root: here }, there);
  }
  python.globals.set('arguments', python.toPy(pytest));
  const status = python.runPython(`
import os, sys
sys.path[:0] = ["/barewire/src", "/barewire/workbench/src", "/barewire", "/site"]
sys.dont_write_bytecode = True
os.chdir("/barewire")
print("CPython", sys.version.split()[0], "on", sys.platform)
import pytest
int(pytest.main(["-p", "no:cacheprovider", *arguments]))
`);
  process.exit(status);
}
