// Runs Python beside the page: loads Pyodide and the package, then answers calls.
//
//   page --{id, name, text}--> worker --bridge.call(name, text)--> Python
//        <--{id, text}--------
//        <--{progress, total}, {ready: version}, {failed: text}

const counted = { loaded: 0, total: 0 };

// Every response is counted as it arrives, for the progress bar of the page.
const plainFetch = self.fetch;
self.fetch = async (resource, options) => {
  const response = await plainFetch(resource, options);
  if (!response.ok || !response.body) return response;
  const count = new TransformStream({
    transform(chunk, out) {
      counted.loaded += chunk.byteLength;
      postMessage({ progress: counted.loaded, total: counted.total });
      out.enqueue(chunk);
    },
  });
  return new Response(response.body.pipeThrough(count), { status: response.status, headers: response.headers });
};

async function start() {
  const manifest = await (await plainFetch("manifest.json")).json();
  counted.total = manifest.bytes;
  const { loadPyodide } = await import("./pyodide/pyodide.mjs");
  const [python, source] = await Promise.all([
    loadPyodide({ indexURL: new URL("pyodide/", self.location.href).href }),
    fetch(manifest.package).then((response) => {
      if (!response.ok) throw new Error(`${manifest.package}: ${response.status}`);
      return response.arrayBuffer();
    }),
  ]);
  python.unpackArchive(source, "zip", { extractDir: "/package" });
  const call = python.runPython(`
import sys
sys.path.insert(0, "/package")
from bridge import call
call
`);
  self.onmessage = ({ data: { id, name, text } }) => {
    try {
      postMessage({ id, text: call(name, text) });
    } catch (error) {
      console.error(error);
      postMessage({ id, text: JSON.stringify({ error: `this is a defect of the explorer: ${lastLine(error)}` }) });
    }
  };
  postMessage({ ready: manifest.version });
}

function lastLine(error) {
  return String(error.message ?? error).trim().split("\n").pop();
}

// Calls that arrive before Python is ready wait in the page.
start().catch((error) => postMessage({ failed: lastLine(error) }));
