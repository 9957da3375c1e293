# SPDX-License-Identifier: Apache-2.0
"""Published problems with optima recomputed by brute force, and what passing them means."""

from cwmav_rbdo.benchmarks.published import BenchmarkRow, benchmark_names, benchmark_problem, run_benchmark

__all__ = ["BenchmarkRow", "benchmark_names", "benchmark_problem", "run_benchmark"]
