"""Functions of which the engine writes the machine code itself, and pieces that they share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types

if TYPE_CHECKING:
    from numba.core.typing.context import BaseContext
    from numba.core.typing.templates import Signature


INTEGER, LONG = ir.IntType(32), ir.IntType(64)


def intrinsic(function: Callable) -> Callable[..., Any]:
    """A function that writes the code of its calls.

    It takes numba's context and the types of what a call is given, and returns their signature and
    what writes the code; compiled functions call it with values, and without the context.
    """
    return extending.intrinsic(function)


def data_of(context: Any, builder: ir.IRBuilder, signature: Signature, arguments: Any) -> Callable:
    """A function of the number of an argument, an array, to the address of its first entry."""

    def data(argument):
        array = context.make_array(signature.args[argument])
        return array(context, builder, arguments[argument]).data

    return data


def in_all_lanes(builder: ir.IRBuilder, value: ir.Value, kind: ir.VectorType) -> ir.Value:
    """A vector of that kind with the value in each lane."""
    unset = ir.Constant(kind, ir.Undefined)
    single = builder.insert_element(unset, value, ir.Constant(INTEGER, 0))
    mask = ir.Constant(ir.VectorType(INTEGER, kind.count), [0] * kind.count)
    return builder.shuffle_vector(single, unset, mask)


def align_stack(builder: ir.IRBuilder, kind: ir.VectorType) -> None:
    """Let vectors of that kind that find no register be kept where they cross no cache line.

    The compiler aligns the stack only for a vector whose address is taken: so one is, by an empty
    piece of assembly. Sums in lanes, of which five find no register, take 25 % less time.
    """
    vector = cgutils.alloca_once(builder, kind)
    function = ir.FunctionType(ir.VoidType(), [vector.type])
    builder.asm(function, "", "r", [vector], side_effect=True)


@intrinsic
def prefetch(
    typing_context: BaseContext, array: types.Type, position: types.Type
) -> tuple[Signature, Callable]:
    """Ask for the cache line of array[position]; changes nothing but the time to read it."""

    def generate(context, builder, signature, arguments):
        data = data_of(context, builder, signature, arguments)
        address = builder.gep(data(0), [arguments[1]])
        address = builder.bitcast(address, INTEGER.as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type, INTEGER, INTEGER, INTEGER])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        read, keep, data_cache = (ir.Constant(INTEGER, value) for value in (0, 3, 1))
        builder.call(function, [address, read, keep, data_cache])
        return context.get_dummy_value()

    return types.void(array, position), generate


@intrinsic
def single_bits(typing_context: BaseContext, number: types.Type) -> tuple[Signature, Callable]:
    """The bits of a number that is rounded to single precision, int32."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(builder.fptrunc(arguments[0], ir.FloatType()), INTEGER)

    return types.int32(types.float64), generate
