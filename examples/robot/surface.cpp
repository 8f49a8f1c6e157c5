// Surface classification in C++, with a file of `texclass export --from samples`.
// Standard input: float32 samples, window by window, channel by channel.
// Output: one line per window with surface, probability, p_known, and "unknown" for an unknown surface.
//
//   g++ -std=c++17 -O2 surface.cpp -I ONNXRUNTIME/include -L ONNXRUNTIME/lib -lonnxruntime -o surface
//   ./surface windows.onnx < samples.f32
//
// ONNXRUNTIME is a release of https://github.com/microsoft/onnxruntime; version 1.15 or later.

#include <onnxruntime_cxx_api.h>

#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: %s MODEL.onnx < samples.f32\n", argv[0]), 2;

  Ort::Env env;
  Ort::SessionOptions options;
  options.SetIntraOpNumThreads(1);  // windows are small: more threads take longer
  Ort::Session session(env, argv[1], options);
  auto shape = session.GetInputTypeInfo(0).GetTensorTypeAndShapeInfo().GetShape();  // n, channels, samples
  shape[0] = 1;

  auto memory = Ort::MemoryInfo::CreateCpu(OrtArenaAllocator, OrtMemTypeDefault);
  std::vector<float> window(shape[1] * shape[2]);
  const char *in[] = {"samples"}, *out[] = {"label", "probabilities", "p_known", "unknown"};
  while (std::fread(window.data(), sizeof(float), window.size(), stdin) == window.size()) {
    auto samples = Ort::Value::CreateTensor<float>(memory, window.data(), window.size(), shape.data(), 3);
    auto answer = session.Run(Ort::RunOptions{nullptr}, in, &samples, 1, out, 4);

    std::string label(answer[0].GetStringTensorElementLength(0), ' ');
    answer[0].GetStringTensorElement(label.size(), 0, label.data());
    const double* p = answer[1].GetTensorData<double>();
    size_t n_surfaces = answer[1].GetTensorTypeAndShapeInfo().GetElementCount();
    bool unknown = *answer[3].GetTensorData<bool>();
    std::printf("%s\t%.9f\t%.9f%s\n", label.c_str(), *std::max_element(p, p + n_surfaces),
                *answer[2].GetTensorData<double>(), unknown ? "\tunknown" : "");
  }
}
