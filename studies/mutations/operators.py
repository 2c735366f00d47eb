"""Small mistakes that a syntax tree allows, each as another text for a piece of a module."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

#: What an operator becomes, by the name of the mistake.
_COMPARED: dict[type[ast.cmpop], list[type[ast.cmpop]]] = {
    ast.Lt: [ast.LtE, ast.GtE],
    ast.LtE: [ast.Lt, ast.Gt],
    ast.Gt: [ast.GtE, ast.LtE],
    ast.GtE: [ast.Gt, ast.Lt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
    ast.Is: [ast.IsNot],
    ast.IsNot: [ast.Is],
    ast.In: [ast.NotIn],
    ast.NotIn: [ast.In],
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_REDUCED = "sum max,max min,min max,any all,all any,argmax argmin,argmin argmax,maximum minimum,minimum maximum"
_REDUCED += ",SUM MAX,MAX MIN,MIN MAX,LAND LOR,LOR LAND"
_OTHER = dict(pair.split() for pair in _REDUCED.split(","))
#: Collective calls of a communicator, and what they are on a rank that is alone with its argument.
_LOCAL = {"allreduce": "{}", "bcast": "{}", "allgather": "[{}]"}
#: Strings that choose something; sentences are not changed.
_OPTION = re.compile(r"[\w.-]+")


@dataclass(frozen=True)
class Mutation:
    """Another text for a piece of a module.

    Attributes:
        file: below the package.
        operator: the kind of mistake.
        start, end: positions in the text of the file.
        new: what stands there instead.
        lines: first and last line whose tests may notice; None: those of any line of the file.
        statement: number of the statement in the file.
    """

    file: str
    operator: str
    start: int
    end: int
    new: str = field(repr=False)
    lines: tuple[int, int] | None
    statement: int

    def __str__(self) -> str:
        return f"{self.file}:{self.start}-{self.end}:{self.operator}:{self.new}"

    def applied(self, text: str) -> str:
        """The text of the file with the mistake."""
        return text[: self.start] + self.new + text[self.end :]

    def changes(self, text: str) -> bool:
        """Python compiles it, and to something else."""
        try:
            return ast.dump(ast.parse(text)) != ast.dump(ast.parse(self.applied(text)))
        except SyntaxError:
            return False


def mutations_of(path: Path, file: str) -> list[Mutation]:
    """All mistakes in a module."""
    return _Module(path.read_text(), file).found


class _Module:
    def __init__(self, text: str, file: str) -> None:
        self.text, self.file, self.found = text, file, list[Mutation]()
        self.starts = [0]
        for line in text.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.statement = -1
        self.lines: tuple[int, int] | None = None
        tree = ast.parse(text)
        self.parent = {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}
        self._block(tree.body, None)

    def _block(self, body: list[ast.stmt], function: ast.FunctionDef | None) -> None:
        for node in body:
            self.statement += 1
            if isinstance(node, (ast.Import, ast.ImportFrom)) or _is_text(node):
                continue
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                self._definition(node)
                continue
            inner = [
                name for name in ("body", "orelse", "finalbody", "handlers", "cases") if getattr(node, name, None)
            ]
            own = [child for child in ast.iter_child_nodes(node) if not isinstance(child, _BLOCKS)]
            ends = [_end(part) for child in own for part in ast.walk(child) if isinstance(part, ast.expr)]
            last = max(ends, default=node.lineno) if inner else _end(node)
            self.lines = (node.lineno, last) if function else None
            for new in _statements(node) if function else ():
                self._add("statement", node, new)
            for child in own:
                if not (isinstance(node, ast.AnnAssign) and child is node.annotation):
                    self._expressions(child)
            for name in inner:
                for part in getattr(node, name):
                    self._block(part.body if isinstance(part, _PARTS) else [part], function)

    def _definition(self, node: ast.FunctionDef | ast.ClassDef) -> None:
        if isinstance(node, ast.FunctionDef):
            self.lines = node.body[0].lineno, _end(node)
            for default in (*node.args.defaults, *node.args.kw_defaults):
                if default is not None:
                    self._expressions(default)
        self._block(node.body, node if isinstance(node, ast.FunctionDef) else None)

    def _expressions(self, root: ast.AST) -> None:
        for node in _walk(root):
            if isinstance(node, ast.expr):
                for operator, new in _changed(node, self.parent):
                    self._add(operator, node, f"({new})" if isinstance(node, _LOOSE) else new)

    def _add(self, operator: str, node: ast.expr | ast.stmt, new: str) -> None:
        start, end = self._at(node.lineno, node.col_offset), self._at(_end(node), node.end_col_offset or 0)
        self.found.append(Mutation(self.file, operator, start, end, new, self.lines, self.statement))

    def _at(self, line: int, column: int) -> int:
        """Position of a line and a column, which counts bytes."""
        start = self.starts[line - 1]
        return start + len(self.text[start : self.starts[line]].encode()[:column].decode())


_BLOCKS = (ast.stmt, ast.ExceptHandler, ast.match_case)
_PARTS = (ast.ExceptHandler, ast.match_case)
_LOOSE = (ast.BinOp, ast.BoolOp, ast.Compare, ast.UnaryOp, ast.IfExp)


def _end(node: ast.expr | ast.stmt) -> int:
    """Last line of a node."""
    return node.end_lineno or node.lineno


def _is_text(node: ast.stmt) -> bool:
    """Docstrings, and strings below attributes."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes below one, without the format of values in strings."""
    yield node
    for child in ast.iter_child_nodes(node):
        if not (isinstance(node, ast.FormattedValue) and child is node.format_spec):
            yield from _walk(child)


def _statements(node: ast.stmt) -> Iterator[str]:
    """What may stand for a whole statement."""
    call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    stored = isinstance(node, ast.Assign) and isinstance(node.targets[0], (ast.Attribute, ast.Subscript))
    if call or stored or isinstance(node, (ast.Raise, ast.AugAssign, ast.Continue, ast.Break)):
        yield "pass"
    if isinstance(node, ast.AugAssign) and type(node.op) in _COMPUTED:
        target, value = ast.unparse(node.target), ast.unparse(node.value)
        yield ast.unparse(ast.AugAssign(node.target, _COMPUTED[type(node.op)](), node.value))
        yield f"{target} = {value}"


def _changed(node: ast.expr, parent: dict[ast.AST, ast.AST]) -> Iterator[tuple[str, str]]:
    """Mistakes in an expression: (kind, new text)."""
    text = ast.unparse
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for op in _COMPARED[type(node.ops[0])]:
            yield "comparison", text(ast.Compare(node.left, [op()], node.comparators))
    elif isinstance(node, ast.BinOp) and type(node.op) in _COMPUTED:
        yield "arithmetic", text(ast.BinOp(node.left, _COMPUTED[type(node.op)](), node.right))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
        yield "sign" if isinstance(node.op, ast.USub) else "boolean", text(node.operand)
    elif isinstance(node, ast.BoolOp):
        yield "boolean", text(ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values))
    elif isinstance(node, ast.Constant):
        yield from _constants(node, parent)
    elif isinstance(node, ast.Attribute) and node.attr in _OTHER:
        yield "reduction", text(ast.Attribute(node.value, _OTHER[node.attr]))
    elif isinstance(node, ast.Call):
        yield from _calls(node)
    test = getattr(parent[node], "test", None)
    if test is node and isinstance(node, (ast.Name, ast.Attribute, ast.Call, ast.Subscript)):
        yield "boolean", f"(not {text(node)})"


def _constants(node: ast.Constant, parent: dict[ast.AST, ast.AST]) -> Iterator[tuple[str, str]]:
    above, value = parent[node], node.value
    while isinstance(above, (ast.UnaryOp, ast.Tuple, ast.Slice)):
        above = parent[above]
    axis = isinstance(above, ast.keyword) and above.arg == "axis"
    kind = "index" if isinstance(above, ast.Subscript) or axis else "constant"
    if isinstance(above, ast.arguments):
        kind = "default"
    if isinstance(value, bool):
        yield kind, str(not value)
    elif isinstance(value, (int, float)):
        for new in dict.fromkeys((value + 1, value - 1, 2 * value, 0, 1)):
            if new != value and (kind != "index" or abs(new) <= 3):
                yield kind, f"({new!r})" if new < 0 else repr(new)
    elif isinstance(value, str) and _OPTION.fullmatch(value) and not isinstance(above, ast.JoinedStr):
        yield kind, repr(f"{value}x")


def _calls(node: ast.Call) -> Iterator[tuple[str, str]]:
    name, arguments = getattr(node.func, "attr", getattr(node.func, "id", "")), node.args
    if name in _LOCAL and isinstance(node.func, ast.Attribute) and arguments:
        yield "reduction", "(" + _LOCAL[name].format(ast.unparse(arguments[0])) + ")"
    if isinstance(node.func, ast.Name) and name in _OTHER:
        yield "reduction", ast.unparse(ast.Call(ast.Name(_OTHER[name]), arguments, node.keywords))
    for one in range(len(arguments) - 1):
        # Of different kinds, or to these functions, they would end in a TypeError.
        if type(arguments[one]) is not type(arguments[one + 1]) or name in ("isinstance", "getattr", "setattr"):
            continue
        swapped = [*arguments[:one], arguments[one + 1], arguments[one], *arguments[one + 2 :]]
        yield "arguments", ast.unparse(ast.Call(node.func, swapped, node.keywords))
    for keyword in node.keywords:
        kept = [other for other in node.keywords if other is not keyword]
        yield "keyword", ast.unparse(ast.Call(node.func, arguments, kept))
