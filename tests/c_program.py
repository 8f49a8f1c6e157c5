"""Compile a C program that renders a scene with `texclass_render.h`, and run it."""

import shutil
import subprocess

import numpy as np
import pytest

from texclass.haptics.scene import write_c_header

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CPP_COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc or clang) is installed")
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
PROGRAM = r"""
#include <stdio.h>
#include "scene.h"

enum { MAX_SAMPLES = 20000 };
static double voices[SCENE_VOICES], surfaces[MAX_SAMPLES], taps[MAX_SAMPLES];
static double vx[MAX_SAMPLES], vy[MAX_SAMPLES], force[MAX_SAMPLES], out[MAX_SAMPLES];
static texclass_contact contact;

int main(int argc, char **argv) {
  const size_t n = fread(surfaces, sizeof(double), MAX_SAMPLES, stdin) / 5;
  memcpy(taps, surfaces + n, n * sizeof(double));
  memcpy(vx, surfaces + 2 * n, n * sizeof(double));
  memcpy(vy, surfaces + 3 * n, n * sizeof(double));
  memcpy(force, surfaces + 4 * n, n * sizeof(double));
  texclass_start(&contact, &scene_scene, voices, SCENE_SEED);
  for (size_t t = 0, end = 0; t < n; t = end) {
    texclass_touch(&contact, (int32_t)surfaces[t]);
    if (taps[t] != 0) texclass_tap(&contact, (int32_t)surfaces[t], taps[t]);
    if (argc > 1 && argv[1][0] == 'b') {
      for (end = t + 1; end < n && taps[end] == 0 && surfaces[end] == surfaces[t]; end++) {}
      texclass_process(&contact, end - t, vx + t, vy + t, force + t, out + t);
    } else {
      out[t] = texclass_step(&contact, vx[t], vy[t], force[t]);
      end = t + 1;
    }
  }
  fwrite(out, sizeof(double), n, stdout);
  fprintf(stderr, "%lu %ld", (unsigned long)sizeof contact, (long)contact.n_refused);
  return 0;
}
"""


def compile_c(arguments, *, language="c99"):
    """Compile with all warnings as errors."""
    compiler = COMPILER if language == "c99" else CPP_COMPILER
    command = [compiler, f"-std={language}", "-O2", *WARNINGS, *arguments, "-lm"]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not compiled.returncode, compiled.stderr
    assert not compiled.stderr


def build(folder, scene, taps=None, *, language="c99"):
    """Write and compile a scene, and return the program."""
    write_c_header(folder / "scene.h", scene, taps=taps)
    source = folder / ("main.c" if language == "c99" else "main.cpp")
    source.write_text(PROGRAM)
    compile_c([source, "-o", folder / "render"], language=language)
    return folder / "render"


def run(program, surfaces, velocity, force, taps=None, *, mode="samples"):
    """Return the samples of a compiled scene, the size of its state, and the number of refused inputs."""
    taps = np.zeros(force.size) if taps is None else taps
    data = np.concatenate([surfaces, taps, *velocity.T, force]).astype(np.float64).tobytes()
    process = subprocess.run([program, mode], input=data, capture_output=True, check=True)
    size, n_refused = map(int, process.stderr.split())
    return np.frombuffer(process.stdout), size, n_refused
