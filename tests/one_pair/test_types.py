"""What users call says the types of all that it takes and returns."""

import inspect

import pytest

import icpshap


def public(owner):
    """Functions and properties of a class that have no underscore in front."""
    for name, member in vars(owner).items():
        if name[0] == "_":
            continue
        if isinstance(member, property):
            yield f"{owner.__name__}.{name}", member.fget
        elif callable(getattr(member, "__func__", member)) and not isinstance(member, type):
            yield f"{owner.__name__}.{name}", getattr(member, "__func__", member)


CALLED = {
    **{name: getattr(icpshap, name) for name in ("explain", "fit_table", "read_scan")},
    **dict(public(icpshap.Explanation)),
    **dict(public(icpshap.PoseCovariance)),
}


@pytest.mark.parametrize("name", CALLED)
def test_signatures_are_typed_and_documented(name):
    function = CALLED[name]
    signature = inspect.signature(function)
    taken = [part for part in signature.parameters.values() if part.name not in ("self", "cls")]
    assert all(part.annotation is not inspect.Parameter.empty for part in taken)
    assert signature.return_annotation is not inspect.Signature.empty
    assert inspect.getdoc(function)
