"""Damaged result folders: what the commands make of broken, foreign and forged stage, chain and result files."""
