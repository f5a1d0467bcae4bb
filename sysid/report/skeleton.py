"""What all pages share: templates, style and script in the page, and a policy that forbids everything else."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import jinja2
from markupsafe import Markup

from sysid.numbers import MISSING, count, fixed, number, percent
from sysid.wording import plain_text


def render_page(
    template: str, content: Mapping[str, Any], name: str = "page", style_name: str = "style", connects: bool = False
) -> str:
    """A page from one of our templates: everything in `content` that is no Markup is escaped.

    Parameters
    ----------
    name, style_name : of its script and its style sheet. connects : whether the script may ask where the page is from.
    """
    style, script = _asset(f"{style_name}.css"), _asset(f"{name}.js")
    # The policy admits exactly our style sheet and our script, by hash: injected ones would not run.
    policy = "; ".join(
        (
            "default-src 'none'",
            f"style-src '{_hash(style)}'",
            f"script-src '{_hash(script)}'",
            "img-src data:",
            *(["connect-src 'self'"] if connects else []),
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    return render_part(template, {**content, "policy": policy, "style": Markup(style), "script": Markup(script)})


def render_part(template: str, content: Mapping[str, Any]) -> str:
    """A part of a page: everything in `content` that is no Markup is escaped."""
    return _environment().get_template(template).render(**content)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("sysid.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "fixed": fixed, "percent": percent, "count": count, "next": next}
    return environment


def _finalize(value: Any) -> Any:
    """What a template prints: a dash for None, text without control and direction-override characters."""
    if value is None:
        return MISSING
    if isinstance(value, Markup) or not isinstance(value, str):
        return value
    return plain_text(value)


def _asset(name: str) -> str:
    return resources.files("sysid.report").joinpath("templates", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
