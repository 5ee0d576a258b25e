// Unpacks and colours the cells of a map or a sweep outside the page's thread: one of 4000 x 4000 cells takes some 0.2 s.

let cells = null;
let about = null; // the message, without its bytes
let colours = null;

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Int8Array(await new Response(stream).arrayBuffer());
}

async function paint() {
  if (!cells || !colours) return;
  const image = new ImageData(about.width, about.height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < cells.length; i++) pixels[i] = colours[cells[i] & 255];
  const bitmap = await createImageBitmap(image);
  postMessage({ bitmap, message: about }, [bitmap]);
}

/** Colour of each cell value: free, occupied and between them; unknown is clear, so that the ground shows. */
function palette({ free, occupied }) {
  const found = new Uint32Array(256);
  for (let value = 0; value <= 100; value++) {
    const mix = free.map((from, i) => Math.round(from + (occupied[i] - from) * (value / 100)));
    found[value] = (255 << 24) | (mix[2] << 16) | (mix[1] << 8) | mix[0];
  }
  return found;
}

let work = Promise.resolve();
onmessage = ({ data }) => {
  work = work.then(async () => {
    if (data.colours) colours = palette(data.colours);
    if (data.bytes) {
      const { bytes, ...others } = data;
      cells = await inflated(bytes);
      about = others;
    }
    await paint();
  });
};
