"""Functions of which the engine writes the machine code itself, and pieces that they share."""

import functools
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types

INTEGER, LONG = ir.IntType(32), ir.IntType(64)
ARRAY = None  # among the types of arguments


@dataclass
class Code:
    """The code of one call: what writes it, and the values that the call is given.

    Of an array that is the address of its first entry.
    """

    builder: ir.IRBuilder
    arguments: list[ir.Value]

    def entry(self, array: ir.Value, place: ir.Value) -> ir.Value:
        """Entry of an array."""
        return self.builder.load(self.builder.gep(array, [place]))

    def address(self, array: ir.Value, place: ir.Value, kind: ir.Type) -> ir.Value:
        """Address of an entry of an array, where something of that kind begins."""
        return self.builder.bitcast(self.builder.gep(array, [place]), kind.as_pointer())

    def in_all_lanes(self, value: ir.Value, kind: ir.VectorType) -> ir.Value:
        """A vector of that kind with the value in each lane."""
        unset = kind(ir.Undefined)
        single = self.builder.insert_element(unset, value, INTEGER(0))
        return self.builder.shuffle_vector(single, unset, ir.VectorType(INTEGER, kind.count)(0))

    def columns(self, rows: ir.Value, number: int) -> Iterator[ir.Value]:
        """The first columns of rows of four numbers, which follow one another in a vector."""
        lanes = rows.type.count // 4
        for column in range(number):
            places = ir.VectorType(INTEGER, lanes)([4 * lane + column for lane in range(lanes)])
            yield self.builder.shuffle_vector(rows, rows.type(ir.Undefined), places)

    def joined(self, vectors: list[ir.Value]) -> ir.Value:
        """The entries of vectors, a power of two of them, in one."""
        while len(vectors) > 1:
            size = 2 * vectors[0].type.count
            both = ir.VectorType(INTEGER, size)(list(range(size)))
            pairs = zip(vectors[::2], vectors[1::2], strict=True)
            vectors = [self.builder.shuffle_vector(a, b, both) for a, b in pairs]
        return vectors[0]

    def bits(self, lanes: ir.Value) -> ir.Value:
        """A bit for each truth value of a vector, as a LONG."""
        bits = self.builder.bitcast(lanes, ir.IntType(lanes.type.count))
        return self.builder.zext(bits, LONG)

    def operation(self, name: str, kind: ir.Type, *operands: ir.Value) -> ir.Value:
        """The result, of that kind, of one of the compiler's own operations."""
        function = ir.FunctionType(kind, [operand.type for operand in operands])
        function = cgutils.get_or_insert_function(self.builder.module, function, name)
        return self.builder.call(function, operands)

    def align_stack(self, kind: ir.VectorType) -> None:
        """Let vectors of that kind that find no register be kept where they cross no cache line.

        The compiler aligns the stack only for a vector whose address is taken: so one is, by an
        empty piece of assembly. Sums in lanes, of which five find no register, take 25 % less time.
        """
        vector = cgutils.alloca_once(self.builder, kind)
        function = ir.FunctionType(ir.VoidType(), [vector.type])
        self.builder.asm(function, "", "r", [vector], side_effect=True)


def intrinsic(result: types.Type, *inputs: types.Type | None) -> Callable[[Callable], Callable]:
    """Make a function that writes the `Code` of its calls one that compiled functions can call.

    inputs: the type of each argument, or ARRAY. The function returns a value, a tuple or nothing.
    """

    def callable_intrinsic(function):
        def write(context, builder, signature, values):
            arguments = [
                value if wanted else context.make_array(kind)(context, builder, value).data
                for wanted, kind, value in zip(inputs, signature.args, values, strict=True)
            ]
            returned = function(Code(builder, arguments))
            if returned is None:
                return context.get_dummy_value()
            if isinstance(returned, tuple):
                return context.make_tuple(builder, signature.return_type, returned)
            return returned

        @functools.wraps(function)
        def types_and_code(context, *given):
            kinds = [wanted or kind for wanted, kind in zip(inputs, given, strict=True)]
            return result(*kinds), write

        # numba asks for names of what it gives: the context, and each argument's type.
        names = [f"given_{number}" for number in range(1 + len(inputs))]
        parameters = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in names]
        types_and_code.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return extending.intrinsic(types_and_code)

    return callable_intrinsic


@intrinsic(types.void, ARRAY, types.int64)
def prefetch(code: Code) -> None:
    """prefetch(array, position): ask for a cache line; changes nothing but the time to read it."""
    array, position = code.arguments
    address = code.address(array, position, INTEGER)
    read, keep, data_cache = INTEGER(0), INTEGER(3), INTEGER(1)
    code.operation("llvm.prefetch.p0", ir.VoidType(), address, read, keep, data_cache)
