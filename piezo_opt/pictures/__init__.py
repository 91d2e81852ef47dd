"""What a picture shows: the same for the page of the workbench and for the report."""

from piezo_opt.pictures.picture import Axis, Panel, Picture, Style, Tone, Trace, plain

__all__ = ["Axis", "Panel", "Picture", "Style", "Tone", "Trace", "plain"]
