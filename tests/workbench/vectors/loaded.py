"""The vectors of this repository, read once for all tests, and asked once."""

from __future__ import annotations

from barewire_workbench.vectors.files import VectorFile, Vectors, load_vectors
from barewire_workbench.vectors.questions import Case, Question


class AskedOnce(Vectors):
    """Vectors that make the questions and the digest of each of their own cases once, not in each run of the cases."""

    def questions(self, file: VectorFile, case: Case) -> tuple[Question, ...]:
        if OWN.get(id(case)) != (file.name, file.kind):
            return super().questions(file, case)
        if id(case) not in QUESTIONS:
            QUESTIONS[id(case)] = super().questions(file, case)
        return QUESTIONS[id(case)]

    def damage(self, case: Case) -> str:
        if id(case) not in OWN or self.digests is not VECTORS.digests:
            return super().damage(case)
        if id(case) not in DAMAGES:
            DAMAGES[id(case)] = super().damage(case)
        return DAMAGES[id(case)]


VECTORS = AskedOnce(*load_vectors())
OWN = {id(case): (file.name, file.kind) for file in VECTORS.files for case in file.cases}
QUESTIONS: dict[int, tuple[Question, ...]] = {}
DAMAGES: dict[int, str] = {}
