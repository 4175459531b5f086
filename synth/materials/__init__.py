"""Textures of cloth, floors and walls."""
