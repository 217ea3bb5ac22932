# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts in the configuration: settings that choose one by name, and a section of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, GetCoreSchemaHandler, SerializeAsAny
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from slarm_graph import parts
from slarm_graph.config.stage import Stage


@dataclass(frozen=True, slots=True)
class PartName:
    """Marks a setting as the name of a registered part: `Annotated[str, PartName("backend")]`.

    Parameters
    ----------
    kind : str
        A key of `slarm_graph.parts.KINDS`.
    """

    kind: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Accept the names of registered parts only."""
        return core_schema.no_info_after_validator_function(self._checked, handler(source))

    def _checked(self, name: str) -> str:
        parts.find(self.kind, name)
        return name


@dataclass(frozen=True, slots=True)
class UncheckedSection:
    """A section as given, before validation, with its part's name."""

    name: str
    given: object


def _checked_section(section: UncheckedSection) -> Stage:
    """Validate a section by the settings of the part that it is named after."""
    model = parts.section_settings(section.name)
    if model is None:
        raise PydanticCustomError("unknown_section", "no part has this name")
    return model.model_validate(section.given)


Section = Annotated[SerializeAsAny[Stage], BeforeValidator(_checked_section)]
"""The settings of a part, validated by the part that the section is named after."""


def chosen_parts(stage: Stage) -> Iterator[tuple[str, str]]:
    """Yield kind and name of every part that a configuration chooses."""
    for key, field in type(stage).model_fields.items():
        value = getattr(stage, key)
        if isinstance(value, Stage):
            yield from chosen_parts(value)
        for mark in field.metadata:
            if isinstance(mark, PartName):
                yield mark.kind, value
