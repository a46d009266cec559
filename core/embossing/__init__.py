"""embossing"""
