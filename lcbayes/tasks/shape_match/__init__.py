"""`lcbayes shape-match`: candidate shapes by phase angle and brightness, without an attitude."""
