# SPDX-License-Identifier: Apache-2.0
"""Pair rate of the complete solver beside that of DualSPHysics 5 on the processor, in the same run.

``CWMAV_DUALSPHYSICS`` names the folder that holds its programs: ``bin/linux`` of its release, or of a build.
Its case is a closed box of air at rest with our smoothing length and the scheme of the paper, ours the half
model with flapping wings, so its pairs need not pay for sheets, shifting and sides. Processor time is fair
on a busy machine, wall time on an idle one.
"""

import os
import re
import resource
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
import pytest

from cwmav_sim.benchmark import measure, sized_case

pytestmark = [pytest.mark.bench, pytest.mark.timeout(1800)]

VARIABLE = "CWMAV_DUALSPHYSICS"
HOW = (
    f"{VARIABLE} is not set; it names a folder with DualSPHysics5*CPU* and GenCase*, such as bin/linux of "
    "the release at https://dual.sphysics.org (or a build of github.com/DualSPHysics/DualSPHysics)"
)
DP, CELLS = 0.008, 44  # spacing [m] and fluid particles along an edge, 97 336 with the walls
FEW, STEPS = 4, 20  # steps of a short run, and how many more of a long one: the difference has no start

CASE = """<?xml version="1.0" encoding="UTF-8" ?>
<case>
  <casedef>
    <constantsdef>
      <gravity x="0" y="0" z="0" /> <rhop0 value="1.34" /> <rhopgradient value="1" />
      <hswl value="0" auto="true" /> <gamma value="7" /> <speedsystem value="1" auto="false" />
      <coefsound value="20" /> <speedsound value="44.3" auto="false" />
      <hdp value="{h_over_dp}" /> <cflnumber value="0.2" />
    </constantsdef>
    <mkconfig boundcount="240" fluidcount="9" />
    <geometry>
      <definition dp="{dp}">
        <pointmin x="-{dp}" y="-{dp}" z="-{dp}" /> <pointmax x="{end}" y="{end}" z="{end}" />
      </definition>
      <commands>
        <mainlist>
          <setshapemode>dp | bound</setshapemode>
          <setdrawmode mode="full" />
          <setmkfluid mk="0" />
          <drawbox>
            <boxfill>solid</boxfill> <point x="0" y="0" z="0" /> <size x="{fluid}" y="{fluid}" z="{fluid}" />
          </drawbox>
          <setmkbound mk="0" />
          <drawbox>
            <boxfill>all</boxfill> <point x="-{dp}" y="-{dp}" z="-{dp}" />
            <size x="{walls}" y="{walls}" z="{walls}" />
          </drawbox>
        </mainlist>
      </commands>
    </geometry>
  </casedef>
  <execution>
    <parameters>
      <parameter key="StepAlgorithm" value="2" /> <parameter key="Kernel" value="2" />
      <parameter key="ViscoTreatment" value="3" /> <parameter key="Visco" value="1.48e-5" />
      <parameter key="DensityDT" value="2" /> <parameter key="DensityDTvalue" value="0.1" />
      <parameter key="Shifting" value="0" />
      <parameter key="TimeMax" value="1" /> <parameter key="TimeOut" value="1" />
      <parameter key="RhopOutMin" value="0.5" /> <parameter key="RhopOutMax" value="3" />
    </parameters>
  </execution>
</case>
"""


@dataclass(frozen=True)
class Run:
    """What a run of the peer cost: pairs visited [1e9], wall and processor time [s]."""

    particles: int
    gigapairs: float
    wall: float
    cpu: float


@pytest.fixture(scope="module")
def programs():
    named = os.environ.get(VARIABLE)
    if not named:
        pytest.skip(HOW)
    folder = Path(named) if Path(named).is_dir() else Path(named).parent
    found = [sorted(folder.glob(pattern)) for pattern in ("GenCase*", "DualSPHysics5*CPU*")]
    if not all(found):
        pytest.fail(f"{folder}: holds no GenCase* or no DualSPHysics5*CPU*")
    return found[0][-1], found[1][-1]


@pytest.fixture(scope="module")
def box(programs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("box")
    fluid = (CELLS - 1) * DP
    sizes = {"dp": DP, "fluid": fluid, "walls": fluid + 2 * DP, "end": fluid + 3 * DP}
    sizes["h_over_dp"] = sized_case(CELLS**3).flow.resolution.h_over_dp
    (folder / "Box_Def.xml").write_text(CASE.format(**sizes))
    call(programs[0], "Box_Def", "out/Box", cwd=folder)
    return folder


@pytest.fixture
def threads():
    before = numba.get_num_threads()
    yield numba.set_num_threads
    numba.set_num_threads(before)


def call(program, *arguments, cwd):
    """Run a program of the peer, which needs the libraries beside it, and return what it prints."""
    environment = os.environ | {"LD_LIBRARY_PATH": str(program.parent)}
    done = subprocess.run(
        [program, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]
    return done.stdout


def run(program, folder, count, steps):
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    options = (f"-ompthreads:{count}", "-cellmode:half", f"-nsteps:{steps}", "-svpips:1:1000000", "-sv:none")
    text = call(program, "out/Box", f"run_{count}_{steps}", *options, cwd=folder)
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    total = re.search(r"Total particle interactions.*\(([\d.e+]+) \+ ([\d.e+]+)\)", text)
    particles = re.search(r"Total particles: ([\d,]+)", text)
    assert total, text[-3000:]
    assert particles, text[-3000:]
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(int(particles[1].replace(",", "")), 1e-9 * (float(total[1]) + float(total[2])), wall, cpu)


def peer(program, folder, count):
    """Cost of the steps alone, the start left out."""
    few, many = run(program, folder, count, FEW), run(program, folder, count, FEW + STEPS)
    pairs = many.gigapairs - few.gigapairs
    return Run(many.particles, pairs, many.wall - few.wall, many.cpu - few.cpu)


def lattice_neighbours():
    """Neighbours nearer than 2 h in a cubic lattice, which their particles hardly leave in a few steps."""
    axis = np.arange(-4, 5)
    offset = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    support = 2.0 * sized_case(CELLS**3).flow.resolution.h_over_dp
    return np.count_nonzero(np.linalg.norm(offset, axis=1) < support - 1e-9) - 1


@pytest.mark.parametrize("count", [1, 2])
def test_threads(benchmarks, programs, box, threads, count):
    if count > numba.config.NUMBA_NUM_THREADS:
        pytest.skip("one thread only")
    threads(count)
    other = peer(programs[1], box, count)
    ours = measure(other.particles, seconds=8.0)
    assert ours.particles == pytest.approx(other.particles, rel=0.03)
    neighbours = 1e9 * other.gigapairs / (2 * STEPS * other.particles)
    assert neighbours == pytest.approx(lattice_neighbours(), rel=0.15)  # the walls' particles have fewer
    pairs = 1e-6 * ours.pair_interactions_per_s * ours.seconds
    steps = 1e-6 * ours.particles * ours.steps
    other_pairs, other_steps = 1e3 * other.gigapairs, 1e-6 * other.particles * STEPS
    name = re.sub(r"CPU.*", "", programs[1].name).replace("DualSPHysics", "DualSPHysics ")
    for kind, own, theirs in (("processor", ours.cpu_seconds, other.cpu), ("wall", ours.seconds, other.wall)):
        what = f"{ours.particles} particles, {count} thread(s), {kind} time"
        benchmarks.rate(f"SPH pairs of {what}", pairs / own, "million/s", other_pairs / theirs, name)
        benchmarks.rate(f"SPH particle-steps of {what}", steps / own, "million/s", other_steps / theirs, name)
