"""LLVM: from the text of a module to a function in this process."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
from typing import Any

import jax
import llvmlite
import llvmlite.binding as llvm

from jaxmodel.base.cache import keep, kept
from jaxmodel.base.errors import UserError

# The LLVM of an older one refuses the text of every kernel, as if no function had instructions.
_OLDEST = (0, 45)
if tuple(map(int, llvmlite.__version__.split(".")[:2])) < _OLDEST:
    raise UserError(
        f"llvmlite {llvmlite.__version__} is too old to compile a model; "
        f"install {'.'.join(map(str, _OLDEST))} or newer: pip install --upgrade llvmlite."
    )
# How the names of features begin that say which instructions there are for floating-point numbers.
_OF_VECTORS = ("avx", "fma", "neon", "sve", "fp-armv8")


def is_quick() -> bool:
    """Return whether to compile in a third of the time, to slower code: where JAX is asked to do so, as in tests."""
    return bool(jax.config.read("jax_disable_most_optimizations"))


@functools.cache
def target(quick: bool = False) -> Any:
    """Return the target machine of this host."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=1 if quick else 3, jit=True,
        reloc="pic" if os.name != "nt" else "default",
    )  # fmt: skip


def vector_bits() -> int:
    """Return the size of this processor's vector registers."""
    features = llvm.get_host_cpu_features()
    if features.get("avx512f"):
        return 512
    return 256 if features.get("avx2") or features.get("avx") else 128


def processor() -> str:
    """Return what the bits of a result depend on: the processor's name for the compiler, and its vector features."""
    features = llvm.get_host_cpu_features()
    vectors = [name for name in sorted(features) if features[name] and name.startswith(_OF_VECTORS)]
    return f"{llvm.get_host_cpu_name()} ({' '.join(vectors)})"


class Function:
    """A compiled function; it lives as long as this object.

    Attributes:
        call: with the arguments as they were declared.
    """

    def __init__(self, image: bytes, name: str, arguments: list[Any]) -> None:
        self._jit = llvm.create_lljit_compiler(target(), suppress_errors=False, use_jit_link=False)
        builder = llvm.JITLibraryBuilder().add_object_img(image).export_symbol(name).add_current_process()
        self._library = builder.link(self._jit, name)
        self.call = ctypes.CFUNCTYPE(None, *arguments)(self._library[name])


def load(text: str, name: str, arguments: list[Any], kept_on_disk: bool = True) -> Function:
    """Return a function of a module, compiled, or from the folder of compiled programs."""
    return Function(_image(text) if kept_on_disk else _compiled(text), name, arguments)


def _image(text: str) -> bytes:
    """Return the machine code, kept by content: of the module, of the compiler and of the processor."""
    machine, quick = target(), is_quick()
    made_by = (
        str(quick),
        llvmlite.__version__,
        machine.triple,
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    )
    name = digest(*made_by, text) + ".o"
    if (image := kept(name)) is not None:
        return image
    image = _compiled(text)
    keep(name, image)
    return image


def digest(*texts: str) -> str:
    """Return the SHA-256 of texts."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


def assembly(text: str) -> str:
    """Return the machine code of a module as text, to be counted."""
    return target().emit_assembly(_optimised(text))


def compiled_for(other: Any, text: str) -> str:
    """Return the assembly of a module for a machine that is not this host's."""
    module = llvm.parse_assembly(text)
    module.triple = other.triple
    return other.emit_assembly(_improved(module, other))


def _compiled(text: str) -> bytes:
    quick = is_quick()
    return target(quick).emit_object(_parsed(text) if quick else _optimised(text))


def _parsed(text: str) -> Any:
    module = llvm.parse_assembly(text)
    module.triple = target().triple
    return module


def _optimised(text: str) -> Any:
    return _improved(_parsed(text), target())


def _improved(module: Any, machine: Any) -> Any:
    """Return a module after LLVM's passes; its vectors and loops are ours already."""
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return module
