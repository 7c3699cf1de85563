"""A contract of import-linter: modules import other packages by their face, the `__init__`, alone.

The contract checks for every package what the built-in `protected` contract checks for one. A
module may import any module of the packages that it lies in. Of a package that it does not lie in,
it may import only the outermost package by name. A corridor is a package without a face: there, the
packages (rooms) inside it are imported by name instead.
"""

from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class FacesContract(Contract):
    """The contract that modules import another package by its name, not a module inside it.

    Options:
        packages: names of the top-level packages to check.
        corridors: names of packages that have no face; their rooms are imported by name.
    """

    type_name = "faces"

    packages = fields.ListField(subfield=fields.StringField())
    corridors = fields.ListField(subfield=fields.StringField())

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Return the check's result; its metadata lists each import that goes past a face.

        Args:
            graph: all imports among the modules.
            verbose: not used.

        Returns:
            A result that is kept if no import goes past a face. `metadata["past"]` holds importer,
            imported module, the face to import from, and the line number of the import (if there
            are several, that of the first one).
        """
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
        """Print each import that goes past a face, and the package to import from instead."""
        for importer, imported, face, line in check.metadata["past"]:
            where = f"{importer} (l.{line}) reaches past a face for {imported}"
            output.print_error(f"{where}: import the name from {face}")


def _names(field: Any) -> list[str]:
    return [str(name) for name in field]


def _outermost(rooms: set[str], importer: str, imported: str) -> str:
    """Return the outermost package of `rooms` that holds `imported` but not `importer`, or ""."""
    parts = imported.split(".")
    for length in range(1, len(parts) + 1):
        package = ".".join(parts[:length])
        if package in rooms and not f"{importer}.".startswith(f"{package}."):
            return package
    return ""
