// Surface classification in Node, with a file of `texclass export --from samples`.
// Standard input: float32 samples, window by window, channel by channel.
// Output: one line per window with surface, probability, p_known, and "unknown" for an unknown surface.
//
//   npm install onnxruntime-node
//   node surface.cjs windows.onnx < samples.f32
//   node surface.cjs windows.onnx windows.json     (self-check; see `texclass export --json`)

const fs = require("fs");
const { InferenceSession, Tensor } = require("onnxruntime-node");

async function main(model, facts) {
  const session = await InferenceSession.create(model, { intraOpNumThreads: 1 });
  const [, channels, samples] = session.inputMetadata[0].shape;
  const size = channels * samples;

  async function answer(window) {
    const input = new Tensor("float32", window, [1, channels, samples]);
    const { label, probabilities, p_known, unknown } = await session.run({ samples: input });
    return {
      label: label.data[0],
      probabilities: Array.from(probabilities.data),
      p_known: p_known.data[0],
      unknown: Boolean(unknown.data[0]),
    };
  }

  if (facts) return check(JSON.parse(fs.readFileSync(facts, "utf8")), answer, samples);
  const bytes = fs.readFileSync(0);
  const recorded = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
  for (let k = 0; k + size <= recorded.length; k += size) {
    const { label, probabilities, p_known, unknown } = await answer(recorded.slice(k, k + size));
    const columns = [label, Math.max(...probabilities).toFixed(9), p_known.toFixed(9)];
    console.log([...columns, ...(unknown ? ["unknown"] : [])].join("\t"));
  }
}

// Generates the windows by the formula in the metadata, and compares the answers with the stored ones.
async function check(facts, answer, samples) {
  for (const [i, expected] of facts.self_check.entries()) {
    const window = new Float32Array(expected.offset.length * samples);
    let s = expected.seed;
    expected.offset.forEach((offset, c) => {
      for (let t = 0, y = 0; t < samples; t++) {
        s = (1664525 * s + 1013904223) % 4294967296;
        y = expected.smooth * y + s / 4294967296 - 0.5;
        window[c * samples + t] = offset + expected.gain * y;
      }
    });
    const result = await answer(window);
    const difference = Math.max(...result.probabilities.map((p, k) => Math.abs(p - expected.probabilities[k])));
    if (result.label !== expected.label || result.unknown !== expected.unknown || !(difference <= expected.tolerance)) {
      throw new Error(`check ${i} gives ${result.label}, unknown ${result.unknown}, probabilities off by ${difference}`);
    }
  }
  console.log(`${facts.self_check.length} checks with the stored answers`);
}

main(...process.argv.slice(2)).catch((error) => {
  console.error(`error: ${error.message}`);
  process.exit(1);
});
