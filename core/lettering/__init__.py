"""lettering"""
