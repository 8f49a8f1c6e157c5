// Which surface is this, in Node: a file that `texclass export --from samples` wrote, and samples on standard
// input, float32, window after window, channel after channel. One line a window: surface, probability, p_known.
//
//   npm install onnxruntime-node
//   node surface.cjs windows.onnx < felt.f32
//   node surface.cjs windows.onnx windows.json     (the file checks itself; see `texclass export --json`)

const fs = require("fs");
const { InferenceSession, Tensor } = require("onnxruntime-node");

async function main(model, facts) {
  const session = await InferenceSession.create(model, { intraOpNumThreads: 1 });
  const [, channels, samples] = session.inputMetadata[0].shape;
  const size = channels * samples;

  async function answer(window) {
    const felt = new Tensor("float32", window, [1, channels, samples]);
    const { label, probabilities, p_known, unknown } = await session.run({ samples: felt });
    return {
      label: label.data[0],
      probabilities: Array.from(probabilities.data),
      p_known: p_known.data[0],
      unknown: Boolean(unknown.data[0]),
    };
  }

  if (facts) return check(JSON.parse(fs.readFileSync(facts, "utf8")), answer, samples);
  const bytes = fs.readFileSync(0);
  const felt = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  for (let k = 0; k + size <= felt.length; k += size) {
    const { label, probabilities, p_known, unknown } = await answer(felt.slice(k, k + size));
    const said = [label, Math.max(...probabilities).toFixed(9), p_known.toFixed(9)];
    console.log([...said, ...(unknown ? ["unknown"] : [])].join("\t"));
  }
}

// Windows are made by the formula that the facts state; so are the answers that they have to get.
async function check(facts, answer, samples) {
  for (const [i, wanted] of facts.self_check.entries()) {
    const window = new Float32Array(wanted.offset.length * samples);
    let s = wanted.seed;
    wanted.offset.forEach((offset, c) => {
      for (let t = 0, y = 0; t < samples; t++) {
        s = (1664525 * s + 1013904223) % 4294967296;
        y = wanted.smooth * y + s / 4294967296 - 0.5;
        window[c * samples + t] = offset + wanted.gain * y;
      }
    });
    const got = await answer(window);
    const gap = Math.max(...got.probabilities.map((p, k) => Math.abs(p - wanted.probabilities[k])));
    if (got.label !== wanted.label || got.unknown !== wanted.unknown || !(gap <= wanted.tolerance)) {
      throw new Error(`check ${i} gives ${got.label}, unknown ${got.unknown}, probabilities off by ${gap}`);
    }
  }
  console.log(`${facts.self_check.length} checks answered as they have to be`);
}

main(...process.argv.slice(2)).catch((error) => {
  console.error(`error: ${error.message}`);
  process.exit(1);
});
