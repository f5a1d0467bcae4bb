"""Mistakes of bookkeeping and measuring put into campaigns: does `check` name them, and only them?"""
