"""A contract of import-linter: a package is used through its face, its `__init__`, and not past it.

It is what the built-in `protected` contract says of one package, said of every package at once. A
module may import its neighbours in its own packages; of a package that it is not in, it imports the
outermost one alone. A corridor is a package that has rooms and no face: its rooms have theirs.
"""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class FacesContract(Contract):
    """Every package is imported by its name alone.

    Options:
        packages: top-level packages.
        corridors: packages of them whose rooms are imported by name.
    """

    type_name = "faces"

    packages = fields.ListField(subfield=fields.StringField())
    corridors = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Return the imports that go past a face."""
        packages, corridors = _names(self.packages), set(_names(self.corridors))
        modules = {m for m in graph.modules if m.split(".")[0] in packages}
        rooms = {m for m in modules if graph.find_children(m)} - corridors
        past = []
        for importer in sorted(modules):
            for imported in sorted(graph.find_modules_directly_imported_by(importer) & modules):
                face = _outermost(rooms, importer, imported)
                if face and face != imported:
                    details = graph.get_import_details(importer=importer, imported=imported)
                    past.append((importer, imported, face, details[0]["line_number"]))
        return ContractCheck(kept=not past, metadata={"past": past})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print the imports that go past a face, and what to import instead."""
        for importer, imported, face, line in check.metadata["past"]:
            where = f"{importer} (l.{line}) reaches past a face for {imported}"
            output.print_error(f"{where}: import the name from {face}")


def _names(field: Any) -> list[str]:
    return [str(name) for name in field]


def _outermost(rooms: set[str], importer: str, imported: str) -> str:
    """Return the first package on the way to a module that does not hold its importer."""
    parts = imported.split(".")
    for length in range(1, len(parts) + 1):
        package = ".".join(parts[:length])
        if package in rooms and not f"{importer}.".startswith(f"{package}."):
            return package
    return ""
