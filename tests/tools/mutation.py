"""Mutation of pure code: every rule removed once, in the running functions, without a new process.

A rule is the condition of an ``if`` (or of a conditional expression), or one operand of an ``and``/``or``.
"""

import ast
import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import CodeType, FunctionType, ModuleType


@dataclass(frozen=True)
class Mutant:
    """One change: where it is, and the function's code with it."""

    name: str
    function: FunctionType
    code: CodeType


def mutants(module: ModuleType) -> Iterator[Mutant]:
    """Every mutant of the functions and methods that the module defines."""
    source = inspect.getsource(module)
    functions = dict(_functions(module))
    for number, change in enumerate(_changes(ast.parse(source))):
        tree = ast.parse(source)
        name = list(_changes(tree))[number].apply()
        for path, code in _codes(compile(ast.fix_missing_locations(tree), module.__file__ or "", "exec"), ()):
            function = functions.get(path)
            if function is not None and not _same(code, function.__code__):
                yield Mutant(f"{change.line}: {name}", function, code)


def survivors(module: ModuleType, passes: Callable[[], bool]) -> list[str]:
    """Mutants that the check does not notice; ``passes`` must hold without a mutation."""
    assert passes()
    found = []
    for mutant in mutants(module):
        original = mutant.function.__code__
        mutant.function.__code__ = mutant.code
        try:
            killed = not passes()
        except Exception:  # noqa: BLE001 - a mutant may fail in any way
            killed = True
        finally:
            mutant.function.__code__ = original
        if not killed:
            found.append(mutant.name)
    return found


@dataclass
class _Change:
    """A change of a tree that is made by ``apply``."""

    line: int
    make: Callable[[], str]

    def apply(self) -> str:
        return self.make()


def _changes(tree: ast.AST) -> Iterator[_Change]:
    for node in ast.walk(tree):
        if isinstance(node, ast.If | ast.IfExp):
            for value in (False, True):
                yield _Change(node.lineno, _always(node, value))
        elif isinstance(node, ast.BoolOp):
            for index in range(len(node.values)):
                yield _Change(node.lineno, _without(node, index))


def _always(node: ast.If | ast.IfExp, value: bool) -> Callable[[], str]:
    def make() -> str:
        name = f"`{ast.unparse(node.test)}` is always {value}"
        node.test = ast.Constant(value)
        return name

    return make


def _without(node: ast.BoolOp, index: int) -> Callable[[], str]:
    def make() -> str:
        name = f"`{ast.unparse(node)}` without `{ast.unparse(node.values[index])}`"
        node.values = [value for i, value in enumerate(node.values) if i != index]
        if len(node.values) == 1:
            node.values *= 2
        return name

    return make


def _functions(module: ModuleType) -> Iterator[tuple[tuple[str, ...], FunctionType]]:
    for name, value in vars(module).items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__:
            yield (name,), value
        elif inspect.isclass(value) and value.__module__ == module.__name__:
            for inner, member in vars(value).items():
                function = member.fget if isinstance(member, property) else member
                if isinstance(function, FunctionType) and function.__code__.co_filename == module.__file__:
                    yield (name, inner), function


def _codes(code: CodeType, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], CodeType]]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            inner = (*path, constant.co_name)
            yield inner, constant
            yield from _codes(constant, inner)


def _same(a: CodeType, b: CodeType) -> bool:
    constants = [
        (x, y) for x, y in zip(a.co_consts, b.co_consts, strict=False) if not isinstance(x, CodeType)
    ]
    nested = [(x, y) for x, y in zip(a.co_consts, b.co_consts, strict=False) if isinstance(x, CodeType)]
    return (
        a.co_code == b.co_code
        and len(a.co_consts) == len(b.co_consts)
        and all(x == y for x, y in constants)
        and all(isinstance(y, CodeType) and _same(x, y) for x, y in nested)
    )
