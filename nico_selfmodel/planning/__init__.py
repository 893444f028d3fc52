"""Every answer to "which poses?": what is in view, sweeps, random poses, boards, mirrors."""
