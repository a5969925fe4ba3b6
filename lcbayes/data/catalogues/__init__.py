"""Catalogues: the light curves of many objects in one table or folder."""
